"""A line on standard error that tells what a long command is doing."""

from __future__ import annotations

from typing import Self


class Progress:
    """The display is a line that tells what goes on; it is silent where nobody looks.

    Parameters
    ----------
    quiet
        Show nothing at all.
    threaded
        Whether a thread may draw: not in a process that forks, nor beside the compiler, which would hold it up.

    """

    def __init__(self, quiet: bool = False, threaded: bool = True) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as Bar

        console = Console(stderr=True)
        self.is_shown = not quiet and console.is_terminal
        self._threaded = threaded
        self._bar = Bar(
            TextColumn('{task.description}'),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            TextColumn('{task.fields[facts]}'),
            console=console,
            disable=not self.is_shown,
            auto_refresh=threaded,
        )
        self._task = self._bar.add_task('starting', total=None, facts='')

    def show(self, stage: str, done: float = 0, total: float = 0, facts: str = '') -> None:
        """Draw the line anew; without a total it only moves."""
        self._bar.update(
            self._task,
            description=stage,
            completed=done,
            total=total or None,
            facts=facts,
            refresh=not self._threaded,
        )

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()


def announce_compilation(parameters: str | None = None) -> None:
    """Compile what these sources have not been compiled to on this machine yet, and tell how far it is.

    With a file of ``parameters``, or a name of them, that includes what only this kind of robot needs.
    """
    from delta3_pacdrive.numerics.kernel import COMPILING, Lines, all_compiled

    robot = None
    if parameters is not None:
        from delta3_pacdrive import parameters as core

        robot = core.load(parameters)
    if all_compiled('' if robot is None else robot.kind):
        return
    from delta3_pacdrive import simulation

    with Progress(threaded=False) as progress:
        lines = Lines()

        def show(done: int, total: int) -> None:
            if progress.is_shown:
                progress.show(COMPILING, done, total, f'{done}/{total}' if total else str(done))
            else:
                lines.show(done, total)

        simulation.compile_kernels(robot, show)
