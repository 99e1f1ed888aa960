"""Progress display of long commands on standard error."""

from __future__ import annotations

from typing import Self


class Progress:
    """Progress line; shown on terminals only.

    Parameters
    ----------
    quiet
        Never show the line.
    threaded
        Refresh from a thread. Use False in a process that forks or compiles.

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
        """Update the line; without a total the bar only pulses."""
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
    """Compile all kernels that are not yet in the cache, and show the progress.

    ``parameters``, a file or packaged name, adds the kernels of this kind of robot.
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
