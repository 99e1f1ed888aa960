"""Facts about the waking of connections from other threads."""

import asyncio
import threading

import pytest

pytest.importorskip('viser')
from delta3_pacdrive import parameters
from delta3_pacdrive.view import serving
from delta3_pacdrive.view.page import Page
from delta3_pacdrive.view.thread_safe_events import ThreadSafeEvent

CHANGES, BROWSERS, HEARD = 300, 3, 50
WAIT_S = 60.0


@pytest.fixture
def page(monkeypatch):
    """Give a page whose loop complains of whoever wakes it from another thread."""
    monkeypatch.setenv('PYTHONASYNCIODEBUG', '1')
    monkeypatch.setattr(serving, 'PORT', 18742)  # away from those of other tests
    with serving.held(serving.HOST, None) as place:
        made = Page(parameters.load(), place, 'a robot of the tests')
        try:
            yield made
        finally:
            made.close()


def test_a_page_changes_while_browsers_come_wait_and_go(page):
    import viser
    from websockets.sync.client import connect

    over = threading.Event()
    heard = [0] * BROWSERS

    def visit(number):
        while not over.is_set():
            with connect(
                page.url.replace('http', 'ws'),
                subprotocols=[f'viser-v{viser.__version__}'],
                open_timeout=WAIT_S,
                max_size=None,
            ) as connection:
                for _ in range(5 + 3 * number):
                    connection.recv(timeout=WAIT_S)
                    heard[number] += 1

    browsers = [threading.Thread(target=visit, args=(number,)) for number in range(BROWSERS)]
    for browser in browsers:
        browser.start()
    changes = 0
    try:
        while changes < CHANGES or min(heard) < HEARD:
            assert any(browser.is_alive() for browser in browsers)
            page.wait(f'change {changes}')
            changes += 1
    finally:
        over.set()
        for browser in browsers:
            while browser.is_alive():  # it waits for the next change
                page.wait(f'change {changes}')
                changes += 1
                browser.join(0.01)


def test_an_event_that_another_thread_sets_wakes_who_waits_in_its_loop():
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
    threading.Thread(target=event.set).start()  # the loop is closed
