"""Tests of events that other threads set."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress

import pytest

pytest.importorskip('viser')
from delta3_pacdrive import parameters
from delta3_pacdrive.view import serving
from delta3_pacdrive.view.page import Page
from delta3_pacdrive.view.thread_safe_events import ThreadSafeEvent

CHANGES, BROWSERS = 10, 2
SILENCE_S = 0.1  # longer than the page waits for more that goes with what it has sent
WAIT_S = 60.0


@pytest.fixture
def page(monkeypatch):
    """Give a page whose loop reports calls from other threads."""
    monkeypatch.setenv('PYTHONASYNCIODEBUG', '1')
    monkeypatch.setattr(serving, 'PORT', 18742)  # away from those of other tests
    with serving.held(serving.HOST, None) as place:
        made = Page(parameters.load(), place, 'a robot of the tests')
        try:
            yield made
        finally:
            made.close()


def test_a_page_changes_while_browsers_wait_for_changes(page):
    import viser
    from websockets.sync.client import connect

    address, protocol = page.url.replace('http', 'ws'), f'viser-v{viser.__version__}'
    with ExitStack() as stack:
        browsers = [
            stack.enter_context(connect(address, subprotocols=[protocol], open_timeout=WAIT_S, max_size=None))
            for _ in range(BROWSERS)
        ]
        for change in range(CHANGES):
            page.wait(f'change {change}')
            for browser in browsers:
                browser.recv(timeout=WAIT_S)
                with suppress(TimeoutError):  # what there was before; then the page waits for the next change
                    while True:
                        browser.recv(timeout=SILENCE_S)


def test_event_set_by_another_thread_wakes_the_waiting_loop():
    async def main():
        loop = asyncio.get_running_loop()
        loop.set_debug(True)
        event = ThreadSafeEvent(loop)
        for _ in range(100):
            waiting = loop.create_task(event.wait())
            await asyncio.sleep(0)
            await asyncio.to_thread(lambda: [event.set() for _ in range(3)])
            await asyncio.wait_for(waiting, WAIT_S)
            event.clear()
        await asyncio.sleep(0)
        assert not event.is_set()
        event.set()
        assert event.is_set()
        return event

    event = asyncio.run(main())
    with ThreadPoolExecutor(1) as other:
        other.submit(event.set).result(WAIT_S)  # the loop is closed, which is nothing to complain of
