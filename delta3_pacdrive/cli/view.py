"""``delta3 view``: a robot that is up, or a recording, as a page in the browser."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from delta3_pacdrive import interrupts
from delta3_pacdrive.cli.command import Command, NodeOptions, argument, flag, option
from delta3_pacdrive.cli.progress import announce_compilation
from delta3_pacdrive.cli.run_options import require_obeyed
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.view import serving

if TYPE_CHECKING:
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.view.page import Page

NICENESS = 5  # behind the robot, where both are ordinary processes


@dataclass
class Options(NodeOptions):
    """Options of the command."""

    run: str | None = argument(
        'trace (.npz), table of measurements (.csv, .parquet, .mat) or bag to be played, a program to be simulated, '
        'or a volume of delta3 workspace (.npz); without it a robot that is up',
        default=None,
        metavar='RUN',
    )
    host: str = option('address at which the page is served', 'ADDRESS', default=serving.HOST)
    port: int | None = option(
        f'port of the page; the first free one from {serving.PORT} on, unless told', type=int
    )
    control: bool = flag('let people operate the robot on a page that is served to other machines as well')
    parameters: str | None = option(
        'parameter file for a program, or for a recording that does not tell its own', 'FILE'
    )
    columns: str | None = option(
        'column file: what the columns of a table of measurements are, if its headings do not say it', 'FILE'
    )
    dark: bool = flag('begin with a dark page')
    open: bool = flag('open the page in the browser of this desktop')
    wait: bool = flag('wait for a robot as long as it takes')

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if refusal := serving.refusal('--port', self.port):
            return refusal
        if self.run is not None:
            from delta3_pacdrive.analysis.inputs import is_table

            for name, given in (
                ('--control', self.control),
                ('--wait', self.wait),
                ('--namespace', self.namespace != '/'),
            ):
                if given:
                    return f'{name} is for a robot that is up'
            if self.columns and not is_table(self.run):
                return f'--columns is for a table of measurements, {self.run} is none'
        elif self.columns:
            return '--columns is for a table of measurements: a robot that is up has no columns'
        elif self.parameters:
            return '--parameters is for a program or a recording: a robot that is up tells its own'
        return ''


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    with serving.held(options.host, options.port) as place:
        try:
            return _watch(options, place) if options.run is None else _play(options, options.run, place)
        except KeyboardInterrupt:
            if not place.is_told:
                raise
            return 0


def _watch(options: Options, place: serving.Place) -> int:
    """Show a robot that is up."""
    import os

    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.ros import domain

    namespace = domain.namespace(options.namespace)
    _announce(options, place)
    parameters = core.load()
    with _served(options, parameters, f'Delta-3 in {namespace}', place) as page:
        page.wait(f'waiting for a robot in namespace {namespace}')
        if serving.is_here(options.host) or options.control:
            page.add_controls()
        else:
            page.note(
                'This page only shows the robot: `--control` lets people operate it from other machines.'
            )
        page.add_scope()
        page.open()
        from delta3_pacdrive.ros import live_view

        os.nice(NICENESS)  # not before: people wait for the first picture
        patience_s = float('inf') if options.wait else live_view.APPEAR_S
        live_view.run(page, parameters, namespace, patience_s)
    return 0


def _play(options: Options, name: str, place: serving.Place) -> int:
    """Show a run."""
    from delta3_pacdrive.analysis import runs
    from delta3_pacdrive.analysis.inputs import is_recording
    from delta3_pacdrive.view import workspace

    if workspace.Volume.is_one(Path(name)):
        return _show_volume(options, Path(name), place)
    if not is_recording(name):
        announce_compilation(options.parameters)
    found = runs.load(name, options.parameters, columns=options.columns)
    require_obeyed(found, options.parameters)
    from delta3_pacdrive.view import playback

    film = playback.Film(found)
    if film.run.robot_note:
        print(f'note: {film.run.robot_note}', file=sys.stderr)
    _announce(options, place)
    with _served(options, film.robot, Path(name).name, place) as page:
        playback.run(page, film)
    return 0


def _show_volume(options: Options, path: Path, place: serving.Place) -> int:
    """Show the volume of a workspace around the robot."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.view import workspace

    robot, volume = core.load(options.parameters), workspace.Volume.load(path)
    _announce(options, place)
    with _served(options, robot, path.name, place) as page:
        workspace.run(page, robot, volume, path.name)
    return 0


def _announce(options: Options, place: serving.Place) -> None:
    """Say where the page is, before it is made: browsers take as long to load it. Ctrl-C ends what follows."""
    place.greet()
    place.is_told = True
    print(f'the page is at {place.url} ; Ctrl-C ends', file=sys.stderr, flush=True)
    if options.open:
        _open(place.url)


@contextmanager
def _served(options: Options, parameters: 'Parameters', title: str, place: serving.Place) -> Iterator['Page']:
    """Serve the page."""
    with interrupts.answered_by(
        lambda: None, interrupts.PATIENCE_S
    ):  # half a page would swallow a signal, or talk at its end
        from delta3_pacdrive.view.page import Page

        page = Page(parameters, place, title, more=True)
    try:
        if interrupts.asked():
            raise KeyboardInterrupt
        page.darken(options.dark)
        yield page
    finally:
        # browsers that do not answer would delay the end
        interrupts.end_within(interrupts.END_S, 0 if interrupts.asked() else 1)
        page.close()


def _open(url: str) -> None:
    """Open the page in a browser of this desktop; raises RunError."""
    import webbrowser

    try:
        webbrowser.get().open(url)
    except webbrowser.Error:
        raise RunError(f'there is no browser here that could open {url}') from None


main = Command(
    'view',
    'Show a robot that is up, or a recording, as a page in the browser, until Ctrl-C.',
    Options,
    run,
)
