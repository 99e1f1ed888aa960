"""A line that tells what a long command is doing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Self

from delta3_pacdrive import interrupts


class Progress:
    """A line on standard error that tells what goes on; silent where nobody looks.

    Meanwhile Ctrl-C is an exception, so that a study can say what it leaves behind.
    """

    def __init__(self, quiet: bool) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as Bar

        console = Console(stderr=True)
        self._bar = Bar(
            TextColumn('{task.description}'),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            console=console,
            disable=quiet or not console.is_terminal,
        )
        self._task = self._bar.add_task('starting', total=None)

    def show(self, stage: str, done: int, total: int) -> None:
        """Draw the line anew; without a total it only moves."""
        self._bar.update(self._task, description=stage, completed=done, total=total or None)

    def __enter__(self) -> Self:
        self._raising = ExitStack()
        self._raising.enter_context(interrupts.raising())
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()
        self._raising.close()


@contextmanager
def compilation() -> Iterator[Callable[[int, int], None]]:
    """Yield a function that shows how many kernels are compiled: as a bar on a terminal, else by lines."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    from delta3_pacdrive.numerics.kernel import COMPILING, Lines

    console = Console(stderr=True)
    if not console.is_terminal:
        yield Lines().show
        return
    columns = (
        TextColumn('{task.description}'),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    # no thread that draws: the compiler would hold it up, and it the compiler
    with Bar(*columns, console=console, auto_refresh=False) as bar:
        task = bar.add_task(COMPILING)
        yield lambda done, total: bar.update(task, completed=done, total=total, refresh=True)
        done, total = (int(number or 0) for number in (bar.tasks[0].completed, bar.tasks[0].total))
        bar.update(task, completed=max(done, total), refresh=True)
