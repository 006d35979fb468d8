"""Telling how far long work has come."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

#: To be told how many are done, of how many, and what was done last.
Progress = Callable[[int, int, str], None]
#: Given the title of a stage, makes something that is told of it while it runs.
ProgressMaker = Callable[[str], AbstractContextManager[Progress]]


def silent(title: str) -> AbstractContextManager[Progress]:
    """Make a progress that shows nothing.

    Parameters
    ----------
    title
        What is being done.

    Returns
    -------
    AbstractContextManager
        Gives a function that may be told anything.
    """
    del title

    def tell(done: int, total: int, last: str) -> None:
        del done, total, last

    return nullcontext(tell)


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """Show a bar on standard error while the block runs, so that results can be piped.

    Parameters
    ----------
    title
        What is being done.

    Yields
    ------
    Progress
        To be told how far it has come.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description:12s}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[last]}", style="dim"),
    )
    with Bar(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(title, total=None, last="")

        def tell(done: int, total: int, last: str) -> None:
            bar.update(task, completed=done, total=total, last=last)

        yield tell
