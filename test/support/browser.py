"""A real browser for tests of pages: chromium, driven by Playwright, drawing 3-D without a graphics card."""

import shutil
from contextlib import contextmanager

import pytest

NAMES = ('chromium', 'chromium-browser', 'google-chrome')
FLAGS = (
    '--no-sandbox',  # root has none
    '--use-gl=angle',
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
    '--disable-background-networking',
    '--disable-quic',
    '--no-first-run',
)
FRAME_MS = 250  # between two pictures: without a graphics card each takes as long as it takes on all cores
PACED = f"""
window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), {FRAME_MS});
window.cancelAnimationFrame = clearTimeout;
"""
START_MS = WAIT_MS = 180_000  # without a graphics card, on a machine whose cores are all busy


@contextmanager
def chromium():
    """Start a browser and end it; skips the test in one sentence where there is none."""
    playwright = pytest.importorskip(
        'playwright.sync_api', reason='not tested in a browser: Playwright is not installed (extra "test")'
    )
    path = next((found for name in NAMES if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip('not tested in a browser: there is none here (on Debian: apt-get install chromium)')
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=list(FLAGS), timeout=START_MS)
        try:
            yield browser
        finally:
            browser.close()


class Visit:
    """A visit to a page records the network requests and the error messages of the page."""

    def __init__(self, browser, address, width=1280, height=800, scheme='light', **options):
        self.context = browser.new_context(
            viewport={'width': width, 'height': height}, color_scheme=scheme, **options
        )
        self.context.set_default_timeout(WAIT_MS)
        self.context.add_init_script(PACED)
        self.page = self.context.new_page()
        self.requests, self.complaints = [], []
        self.page.on('request', lambda request: self.requests.append(request.url))
        self.page.on('pageerror', lambda error: self.complaints.append(str(error)))
        self.page.on(
            'console',
            lambda said: self.complaints.append(said.text) if said.type in ('error', 'warning') else None,
        )
        self.page.goto(address)

    def __enter__(self):
        return self

    def __exit__(self, _, error, __):
        if error is not None:  # what somebody in front of the screen would tell
            error.add_note(
                f'complaints: {self.complaints}; on the page:\n{self.page.inner_text("body")[:2000]}'
            )
        self.context.close()
