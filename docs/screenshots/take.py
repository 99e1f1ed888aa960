"""Take the pictures of pages that the documentation shows: ``python docs/screenshots/take.py [FOLDER]``.

They are taken in the browser that the tests use (``test/support/browser.py``).
"""

import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

FOLDER = Path(__file__).parent
sys.path.insert(0, str(FOLDER.parents[1] / 'test/support'))

from browser import Visit, chromium  # noqa: E402
from delta3_pacdrive.cli.main import main  # noqa: E402


def report(browser, scratch, picture):
    """Take the report of a pick cycle at an instant, with the error magnified."""
    page = scratch / 'report.html'
    main(['report', 'packaging', '--to', '1.3', '--output', str(page)])
    with Visit(browser, page.as_uri()) as visit:
        visit.page.wait_for_selector('html[data-ready="yes"]', state='attached')
        visit.page.evaluate(
            'magnify.value = 36; magnify.dispatchEvent(new Event("input"));'
            'new Promise(done => { delta3.clock.seek(0.14); requestAnimationFrame(() => requestAnimationFrame(done)) })'
        )
        visit.page.screenshot(path=picture)


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
            address = re.search(r'http\S+', process.stderr.readline())[0]
            with Visit(browser, address) as visit:
                visit.page.get_by_text('playing', exact=True).wait_for()
                visit.page.wait_for_timeout(4000)  # the plots fill
                visit.page.get_by_role('button', name='Pause').click()
                visit.page.evaluate('document.getElementById("webgl-software-rendering")?.remove()')
                visit.page.wait_for_timeout(1000)
                visit.page.screenshot(path=picture)
        finally:
            process.send_signal(signal.SIGINT)


PICTURES = {'report.png': report, 'view.png': view}

if __name__ == '__main__':
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    with chromium() as browser, tempfile.TemporaryDirectory() as scratch:
        for name, take in PICTURES.items():
            take(browser, Path(scratch), folder / name)
            print(folder / name)
