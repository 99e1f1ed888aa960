"""Show the workspace of the robot and a path of your own on a web page."""

import sys
import time

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.view.page import Page
from delta3_pacdrive.view.serving import HOST, held
from delta3_pacdrive.view.values import Facts, Instant

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0

robot = d3.load_parameters()
angle = np.linspace(0.0, 2.0 * np.pi, 600)
flower = (0.3 + 0.1 * np.cos(6.0 * angle))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
path = np.column_stack([flower, -0.8 + 0.05 * np.sin(3.0 * angle)])
arms = d3.kinematics.inverse(path, robot)

with held(HOST, None) as place:
    page = Page(robot, place, 'a flower')
    page.show_path(path)
    print(f'look at {page.url}')
    begin = time.monotonic()
    while (now := time.monotonic() - begin) < seconds:
        page.read(Facts(state='playing', recording='a flower', bus_time_s=now))
        page.show(Instant(now, arms[int(100.0 * now) % len(arms)]))
        time.sleep(0.03)
    page.close()
