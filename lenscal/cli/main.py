"""The one program: commands of lenscal, and those that other packages register."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Final

import click

from lenscal.errors import LensCalError

#: Command name to where it lives; modules load when a command is asked for.
_COMMANDS: Final = {
    "rig": "lenscal.cli.rig:rig",
    "session": "lenscal.cli.session:session",
    "calibrate": "lenscal.cli.calibrate:calibrate",
    "map": "lenscal.cli.map:map_command",
    "contours": "lenscal.cli.contours:contours",
    "export": "lenscal.cli.export:export",
    "import": "lenscal.cli.import_:import_command",
}
#: In which order help lists them: that of the flow.
_ORDER: Final = (
    "demo", "rig", "session", "calibrate", "map", "contours", "export", "import", "report",
    "visibility", "settings", "plan",
)  # fmt: skip


class LazyGroup(click.Group):
    """A group whose commands load only when they are needed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the names of all commands, in the order of the flow.

        Parameters
        ----------
        ctx
            Click's context.

        Returns
        -------
        list of str
            Names.
        """
        del ctx
        names = {*_COMMANDS, *(point.name for point in _registered())}
        return sorted(names, key=lambda n: (_ORDER.index(n) if n in _ORDER else len(_ORDER), n))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Load a command.

        Parameters
        ----------
        ctx
            Click's context.
        cmd_name
            Its name.

        Returns
        -------
        click.Command or None
            The command, or None when there is none of this name.
        """
        del ctx
        if cmd_name in _COMMANDS:
            module, _, name = _COMMANDS[cmd_name].partition(":")
            command = getattr(import_module(module), name)
        else:
            points = [point for point in _registered() if point.name == cmd_name]
            command = points[0].load() if points else None
        return command if isinstance(command, click.Command) else None


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="lenscal", prog_name="lenscal")
def program() -> None:
    """Calibrate programmable zoom lenses, and plan where to put the camera.

    Begin with `lenscal demo`: a whole story on a simulated rig.
    """


def main() -> None:
    """Run the program; an error becomes one line and a non-zero status."""
    try:
        program(standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        sys.exit(error.exit_code)
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        where = f"; see {context.command_path} --help" if context else ""
        click.echo(f"lenscal: {error.format_message().rstrip('.')}{where}", err=True)
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        click.echo("lenscal: stopped; what was recorded so far is kept", err=True)
        sys.exit(130)
    except LensCalError as error:
        click.echo(f"lenscal: {' '.join(str(error).split())}", err=True)
        sys.exit(1)


def _registered() -> list[EntryPoint]:
    return list(entry_points(group="lenscal.commands"))
