"""The page ``docs/cli.md``, made from the commands themselves.

Run ``python -m lenscal.cli.reference > docs/cli.md`` after changing a command.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import click

from lenscal.cli.main import program

_HEAD = """# Commands

Made from the commands by `python -m lenscal.cli.reference > docs/cli.md`; a test compares. An error
is one line on standard error and a status other than zero; progress goes to standard error, results
to standard output.
"""

_WIDTH: Final[dict[str, Any]] = {"terminal_width": 96, "help_option_names": ["-h", "--help"]}


def reference() -> str:
    """Write the page.

    Returns
    -------
    str
        Markdown: the help of every command.
    """
    parts = [_HEAD]
    for context in walk(click.Context(program, info_name="lenscal", **_WIDTH)):
        text = context.command.get_help(context)
        parts.append(f"## {context.command_path}\n\n```text\n{text}\n```\n")
    return "\n".join(parts)


def walk(context: click.Context) -> Iterator[click.Context]:
    """Visit a command and all below it, each in the context that it has when it is typed.

    Parameters
    ----------
    context
        Of the command to begin with.

    Yields
    ------
    click.Context
        Of one command.
    """
    yield context
    if isinstance(context.command, click.Group):
        for name in context.command.list_commands(context):
            found = context.command.get_command(context, name)
            if found is not None:
                yield from walk(click.Context(found, parent=context, info_name=name, **_WIDTH))


if __name__ == "__main__":
    click.echo(reference(), nl=False)
