"""A line that tells what a long command is doing."""

from __future__ import annotations

from typing import Self


class Progress:
    """A line on standard error that tells what goes on; silent where nobody looks."""

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
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()
