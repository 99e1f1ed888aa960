"""Draw every picture of the documentation anew: ``python docs/figures/draw.py [FOLDER]``, into this folder without."""

import sys
from pathlib import Path

FOLDER = Path(__file__).parent
sys.path.insert(0, str(FOLDER))

import calibration  # noqa: E402
import cascade  # noqa: E402
import control  # noqa: E402
import margins  # noqa: E402
import places  # noqa: E402
import rates  # noqa: E402
import robot  # noqa: E402
import shaping  # noqa: E402
import signals  # noqa: E402
import timing  # noqa: E402
import workspace  # noqa: E402

import belts  # noqa: E402
from delta3_pacdrive.studies.framework.figure_style import save  # noqa: E402

PICTURES = {
    'robot.png': robot.make,
    'cascade.png': cascade.make,
    'timing.png': timing.make,
    'workspace.png': workspace.make,
    'three_spheres.png': places.three_spheres,
    'eight_solutions.png': places.eight_solutions,
    'limits.png': places.limits,
    'speed.png': places.speed,
    'speed_profile.png': signals.speed_profile,
    'following_error.png': signals.following_error,
    'fault_stop.png': signals.fault_stop,
    'built_robot.png': signals.built_robot,
    'inside_a_cycle.png': signals.inside_a_cycle,
    'calibration.png': calibration.make,
    'rates.png': rates.make,
    'margins.png': margins.make,
    'shaping.png': shaping.make,
    'control.png': control.make,
    'belts.png': belts.make,
}

if __name__ == '__main__':
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for name, make in PICTURES.items():
        save(make(), folder / name, {'command': 'python docs/figures/draw.py'})
        print(folder / name)
