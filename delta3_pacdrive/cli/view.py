"""``delta3 view``: show a running robot or a recording as a web page."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from delta3_pacdrive import interrupts
from delta3_pacdrive.cli.command import Command, NodeOptions, argument, flag, option
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.progress import announce_compilation
from delta3_pacdrive.cli.run_options import require_no_own_parameters
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.view import serving

if TYPE_CHECKING:
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.view.page import Page

NICENESS = 5  # lower priority than the robot


@dataclass
class Options(NodeOptions):
    """Options of the command."""

    run: str | None = argument(
        'trace (.npz), table of measurements (.csv, .parquet, .mat) or bag to play, program to simulate, or volume of '
        'delta3 workspace (.npz) (default: a running robot)',
        default=None,
        metavar='RUN',
    )
    host: str = option('address to serve the page at', 'ADDRESS', default=serving.HOST)
    port: int | None = option(f'port of the page (default: first free port from {serving.PORT})', type=int)
    control: bool = flag('permit operation of the robot from other machines')
    parameters: str | None = option(
        'parameter file for a program or for a recording without parameters', 'FILE'
    )
    columns: str | None = option(
        'column file that maps the columns of a table to signals; needed if its headings do not', 'FILE'
    )
    dark: bool = flag('start in dark mode')
    open: bool = flag('open the page in the browser of this desktop')
    wait: bool = flag('wait for a robot without timeout')

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if refusal := serving.refusal('--port', self.port):
            return refusal
        if self.run is not None:
            from delta3_pacdrive.studies.runs.inputs import is_table

            for name, given in (
                ('--control', self.control),
                ('--wait', self.wait),
                ('--namespace', self.namespace != '/'),
            ):
                if given:
                    return f'{name} applies to a running robot only'
            if self.columns and not is_table(self.run):
                return f'--columns requires a table of measurements, but {self.run} is not one'
        elif self.columns:
            return '--columns requires a table of measurements'
        elif self.parameters:
            return '--parameters requires a program or a recording: a running robot publishes its parameters'
        return ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    with serving.held(options.host, options.port) as place:
        try:
            if options.run is None:
                _watch(options, place)
            else:
                _play(options, options.run, place)
        except KeyboardInterrupt:
            if not place.is_told:
                raise
    return Output()


def _watch(options: Options, place: serving.Place) -> None:
    """Show a running robot."""
    import os

    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.ros.wire import domain

    namespace = domain.namespace(options.namespace)
    _announce(options, place)
    parameters = core.load()
    with _served(options, parameters, f'Delta-3 in {namespace}', place) as page:
        page.wait(f'waiting for a robot in namespace {namespace}')
        if serving.is_here(options.host) or options.control:
            page.add_controls()
        else:
            page.note('This page is read-only: `--control` permits operation from other machines.')
        page.add_scope()
        page.open()
        from delta3_pacdrive.ros.clients import live_view

        os.nice(NICENESS)  # only now, to show the first picture quickly
        timeout_s = float('inf') if options.wait else live_view.APPEAR_S
        live_view.run(page, parameters, namespace, timeout_s)


def _play(options: Options, name: str, place: serving.Place) -> None:
    """Show a run."""
    from delta3_pacdrive.studies.runs import runs
    from delta3_pacdrive.studies.runs.inputs import is_recording
    from delta3_pacdrive.view import workspace

    if workspace.Volume.is_one(Path(name)):
        _show_volume(options, Path(name), place)
        return
    if not is_recording(name):
        announce_compilation(options.parameters)
    found = runs.load(name, options.parameters, columns=options.columns)
    require_no_own_parameters(found, options.parameters)
    from delta3_pacdrive.view import playback

    film = playback.Film(found)
    if film.run.robot_note:
        print(f'note: {film.run.robot_note}', file=sys.stderr)
    _announce(options, place)
    with _served(options, film.robot, Path(name).name, place) as page:
        playback.run(page, film)


def _show_volume(options: Options, path: Path, place: serving.Place) -> None:
    """Show the robot in the volume of its workspace."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.view import workspace

    robot, volume = core.load(options.parameters), workspace.Volume.load(path)
    _announce(options, place)
    with _served(options, robot, path.name, place) as page:
        workspace.run(page, robot, volume, path.name)


def _announce(options: Options, place: serving.Place) -> None:
    """Print the address before the page is created; a browser that opens it waits for the page."""
    place.is_told = True
    print(f'the page is at {place.url} ; Ctrl-C ends', file=sys.stderr, flush=True)
    if options.open:
        _open(place.url)


@contextmanager
def _served(options: Options, parameters: 'Parameters', title: str, place: serving.Place) -> Iterator['Page']:
    """Serve the page."""
    # an interrupt during the construction of the page would be lost
    with interrupts.answered_by(lambda: None, interrupts.PATIENCE_S):
        from delta3_pacdrive.view.page import Page

        page = Page(parameters, place, title, more=True)
    try:
        if interrupts.asked():
            raise KeyboardInterrupt
        page.darken(options.dark)
        yield page
    finally:
        # browsers that do not respond would delay the exit
        interrupts.end_within(interrupts.END_S, 0 if interrupts.asked() else 1)
        page.close()


def _open(url: str) -> None:
    """Open the page in a browser of this desktop; raises RunError."""
    import webbrowser

    try:
        webbrowser.get().open(url)
    except webbrowser.Error:
        raise RunError(f'no browser available to open {url}') from None


main = Command(
    'view',
    'Show a running robot or a recording as a web page, until Ctrl-C.',
    Options,
    run,
)
