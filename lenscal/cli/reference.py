"""The page ``docs/cli.md``, made from the commands themselves.

Run ``python -m lenscal.cli.reference > docs/cli.md`` after changing a command.
"""

from __future__ import annotations

from collections.abc import Iterator

import click

from lenscal.cli.main import program

_HEAD = """# Commands

Made from the commands by `python -m lenscal.cli.reference > docs/cli.md`; a test compares. An error
is one line on standard error and a status other than zero; progress goes to standard error, results
to standard output.
"""


def reference() -> str:
    """Write the page.

    Returns
    -------
    str
        Markdown: the help of every command.
    """
    parts = [_HEAD]
    for path, command in _walk(("lenscal",), program):
        context = click.Context(command, info_name=" ".join(path), terminal_width=96)
        parts.append(f"## {' '.join(path)}\n\n```text\n{command.get_help(context)}\n```\n")
    return "\n".join(parts)


def _walk(
    path: tuple[str, ...], command: click.Command
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            if found is not None:
                yield from _walk((*path, name), found)


if __name__ == "__main__":
    click.echo(reference(), nl=False)
