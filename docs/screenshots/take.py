"""Take the pictures of pages that the documentation shows: ``python docs/screenshots/take.py [FOLDER]``.

They are taken in the browser that the tests use (``test/support/browser.py``).
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

from PIL import Image

FOLDER = Path(__file__).parent
sys.path.insert(0, str(FOLDER.parents[1] / 'test/support'))

from browser import Visit, chromium  # noqa: E402
from delta3_pacdrive.cli.main import main  # noqa: E402

# the animation of a pick cycle
FRAMES, SLOWER = 36, 3.0
SIZE, FINER = (480, 400), 2  # pixels, and how many are drawn for each
BACKGROUND = (238, 242, 247)  # on light and on dark pages
QUALITY = 72
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
                visit.page.evaluate('document.getElementById("webgl-software-rendering")?.remove()')
                visit.page.wait_for_timeout(1000)
                visit.page.screenshot(path=picture)
        finally:
            process.send_signal(signal.SIGINT)


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


PICTURES = {'report.png': report, 'view.png': view, 'pick_cycle.webp': pick_cycle}

if __name__ == '__main__':
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    with chromium() as browser, tempfile.TemporaryDirectory() as scratch:
        for name, take in PICTURES.items():
            take(browser, Path(scratch), folder / name)
            print(folder / name)
