"""Take the pictures of pages that the documentation shows: ``python docs/screenshots/take.py [FOLDER [--draft]]``.

They are taken in the browser that the tests use (``test/support/browser.py``). A draft of the animation has a quarter
of the pixels; without a graphics card it takes a quarter of the time.
"""

import base64
import io
import re
import signal
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image

FOLDER = Path(__file__).parent
sys.path.insert(0, str(FOLDER.parents[1] / 'test/support'))

from browser import Visit, chromium  # noqa: E402
from delta3_pacdrive import load_parameters, load_program, simulation  # noqa: E402
from delta3_pacdrive.cli.main import main  # noqa: E402
from delta3_pacdrive.recording.acquisition import Acquisition, setting  # noqa: E402
from delta3_pacdrive.view.page import Page  # noqa: E402
from delta3_pacdrive.view.scope_panel import caption  # noqa: E402
from delta3_pacdrive.view.serving import HOST, held  # noqa: E402
from delta3_pacdrive.view.values import Facts, Instant  # noqa: E402

# the animation of a pick cycle
FRAMES, SLOWER = 36, 3.0
SIZE = (480, 400)  # pixels
FINER = 1 if '--draft' in sys.argv else 2  # pixels drawn for one, in both directions
BACKGROUND = (238, 242, 247)  # on light and on dark pages
QUALITY = 72
BETWEEN_S = '2.114'  # two places of the pick cycle
# the second of the rounds, frame by frame, without the buttons and texts above the stage
DRAW_ROUND = """([count, width, height, finer]) => {
  const { stage, clock, report } = delta3;
  const dwells = report.runs[0].moves.filter(([, kind]) => kind === 'dwell');
  const [first, last] = [dwells[2][2], dwells[4][2]];  // two dwells in a round
  stage.ghosts.forEach((ghost) => { ghost.shown = false; });
  stage.shown.travelled = false;
  stage.renderer.setPixelRatio(finer);
  stage.renderer.setSize(width, height, false);
  stage.camera.aspect = width / height;
  stage.camera.updateProjectionMatrix();
  stage.paths.forEach(({ line }) => {
    line.material.resolution.set(width, height);
    Object.assign(line.material, { linewidth: 2.5, opacity: 0.9 });
  });
  stage.camera.position.set(0.95, -1.75, -0.1);
  stage.controls.target.set(0, 0, -0.42);
  stage.controls.update();
  const frames = [];
  for (let n = 0; n < count; n += 1) {
    clock.seek(first + ((last - first) * n) / count);
    stage.draw();
    frames.push(stage.canvas.toDataURL('image/png'));
  }
  return [frames, last - first];
}"""

# charts get their width when they are seen
WIDE_CHARTS = (
    "(count) => [...document.querySelectorAll('.uplot canvas')].filter((c) => c.width > 300).length >= count"
)


@contextmanager
def report_page(browser, scratch):
    """Open the report of a pick cycle, which is written once."""
    page = scratch / 'report.html'
    if not page.exists():
        main(['report', 'packaging', '--to', '1.3', '--output', str(page)])
    with Visit(browser, page.as_uri()) as visit:
        visit.page.wait_for_selector('html[data-ready="yes"]', state='attached')
        yield visit


def report(browser, scratch, picture):
    """Take the report at an instant, with the error magnified."""
    with report_page(browser, scratch) as visit:
        visit.page.evaluate(
            'magnify.value = 36; magnify.dispatchEvent(new Event("input"));'
            'new Promise(done => { delta3.clock.seek(0.14); requestAnimationFrame(() => requestAnimationFrame(done)) })'
        )
        visit.page.screenshot(path=picture)


def address(lines):
    """Read lines until one tells where the page is; before it comes what takes a while, such as compiling."""
    said = []
    for line in lines:
        said.append(line)
        if found := re.search(r'http\S+', line):
            return found[0]
    raise RuntimeError(f'no page: {"".join(said)}')


def view(browser, _, picture):
    """Take the page of a robot that is played, between two places of a pick cycle."""
    command = [
        sys.executable,
        '-P',
        '-m',
        'delta3_pacdrive.cli.main',
        'view',
        'packaging',
        '--parameters',
        'rich',
    ]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            with Visit(browser, address(process.stderr)) as visit:
                visit.page.get_by_text('playing', exact=True).wait_for()
                visit.page.wait_for_timeout(4000)  # the plots fill
                visit.page.get_by_role('button', name='Pause').click()
                time = visit.page.locator('input[type="text"]').first
                time.fill(BETWEEN_S)  # where the robot is fast, however fast the page is drawn here
                time.press('Enter')
                visit.page.evaluate('document.getElementById("webgl-software-rendering")?.remove()')
                visit.page.wait_for_timeout(1000)
                visit.page.screenshot(path=picture)
        finally:
            process.send_signal(signal.SIGINT)


def scope(browser, _, picture):
    """Take the page of a robot whose oscilloscope has caught the begin of a program; its samples are a simulation's."""
    robot, records = load_parameters(), []
    names = ['axis1.current_reference', 'axis1.current', 'axis1.speed_reference', 'axis1.speed']
    asked = setting(robot, names, 16_000.0, 0.2, 'program', pre_trigger_s=0.02)
    trace = simulation.run(load_program('experiment1', robot), robot, Acquisition(asked, records.append))
    (record,) = records
    ends_s = record.time_s[-1]
    with held(HOST, None) as place:
        page = Page(robot, place, 'Delta-3 in /')
    try:
        page.add_controls()
        page.add_scope()
        with Visit(browser, page.url, height=1000) as visit:
            visit.page.get_by_text('Oscilloscope', exact=True).click()
            visit.page.locator('input[value^="axis1.current_ref"]').fill(', '.join(names))
            visit.page.get_by_label('duration s').fill('0.2')
            page.read(Facts(state='moving', enabled=True, in_torque=True, phase='CP4', bus_time_s=ends_s))
            *earlier, last = [
                Instant(
                    time_s,
                    *(trace[name][row] for name in ('arm_angle', 'following_error')),
                    robot.motor.torque_constant_n_m_a * trace['current'][row],
                    trace['current'][row],
                )
                for row, time_s in enumerate(trace.time_s[: np.searchsorted(trace.time_s, ends_s)])
            ]
            for instant in earlier:
                page.show(instant)
            visit.page.wait_for_timeout(1000)  # plots are drawn once in a while
            page.show(last)
            page.scope.show(record)
            page.scope.tell(caption(record))
            visit.page.get_by_text('0 is bus time').first.wait_for()
            visit.page.evaluate('document.getElementById("webgl-software-rendering")?.remove()')
            visit.page.wait_for_function(WIDE_CHARTS, arg=3)
            visit.page.get_by_label('rate Hz').click()  # as soon as nothing covers it
            visit.page.wait_for_timeout(1000)
            visit.page.screenshot(path=picture)
    finally:
        page.close()


def pick_cycle(browser, scratch, picture):
    """Take one round of a pick cycle, slowed down, that goes on and on."""
    with report_page(browser, scratch) as visit:
        drawn, round_s = visit.page.evaluate(DRAW_ROUND, [FRAMES, *SIZE, FINER])
    frames = []
    for text in drawn:
        image = Image.open(io.BytesIO(base64.b64decode(text.partition(',')[2]))).convert('RGBA')
        card = Image.new('RGBA', image.size, (*BACKGROUND, 255))
        card.alpha_composite(image)
        frames.append(card.convert('RGB').resize(SIZE, Image.Resampling.LANCZOS))
    frames[0].save(
        picture,
        save_all=True,
        append_images=frames[1:],
        duration=round(1e3 * SLOWER * round_s / FRAMES),
        loop=0,
        quality=QUALITY,
        method=6,
    )


PICTURES = {'report.png': report, 'view.png': view, 'scope.png': scope, 'pick_cycle.webp': pick_cycle}

if __name__ == '__main__':
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    if not folder.is_dir():
        sys.exit(f'take.py: {folder} is no folder')
    with chromium() as browser, tempfile.TemporaryDirectory() as scratch:
        for name, take in PICTURES.items():
            take(browser, Path(scratch), folder / name)
            print(folder / name)
