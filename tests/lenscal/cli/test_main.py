"""The program as a whole: help, errors, and the page that documents it."""

import re
import subprocess
import sys
from pathlib import Path

import click
import pytest

from lenscal.cli.main import program
from lenscal.cli.reference import walk

ROOT = Path(__file__).parents[3]
COMMANDS = {c.command_path: c.command for c in walk(click.Context(program, info_name="lenscal"))}
LEAVES = {name: c for name, c in COMMANDS.items() if not isinstance(c, click.Group)}


def lenscal(*arguments, cwd=None):
    return subprocess.run(
        [sys.executable, "-c", "from lenscal.cli.main import main; main()", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
    )


@pytest.mark.parametrize("name", LEAVES)
def test_every_command_has_help_with_an_example(name):
    command = LEAVES[name]
    assert re.search(rf"\bExamples?:\n\s+{name} ", command.help), name
    for option in command.params:
        if isinstance(option, click.Option):
            assert option.help, f"{name} {option.name} has no help"


def test_the_page_is_what_the_commands_say():
    """Made in a process of its own: click keeps what it once was asked for help with."""
    page = (ROOT / "docs" / "cli.md").read_text()
    made = subprocess.run(
        [sys.executable, "-m", "lenscal.cli.reference"], capture_output=True, text=True, check=True
    )
    # How lines are broken is click's affair and may change with its version.
    assert page.split() == made.stdout.split(), "run: python -m lenscal.cli.reference > docs/cli.md"


def test_the_commands_of_planning_are_registered():
    for name in ("demo", "visibility", "settings", "plan"):
        assert f"lenscal {name}" in COMMANDS


def test_help_loads_nothing_heavy():
    """Modules that take long to import come in only when a command runs."""
    code = (
        "import sys\n"
        "from click.testing import CliRunner\n"
        "from lenscal.cli.main import program\n"
        "result = CliRunner().invoke(program, ['--help'])\n"
        "assert result.exit_code == 0, result.output\n"
        "heavy = {'scipy', 'cv2', 'matplotlib', 'pandas', 'trimesh'} & set(sys.modules)\n"
        "sys.exit(', '.join(sorted(heavy)) or None)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_an_error_is_one_line_and_a_status(tmp_path):
    done = lenscal("map", "show", tmp_path / "none.json", "--zoom", 98, "--focus", 100)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("lenscal: cannot read ")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["sesion"], "No such command 'sesion'"),
        (["map", "show"], "Missing argument 'MAP'"),
        (["map", "show", "m.json", "--zoom", "wide"], "'wide' is not a valid float"),
    ],
)
def test_wrong_words_are_usage_errors(words, message):
    done = lenscal(*words)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.startswith("lenscal: ")
    assert done.stderr.count("\n") == 1
    assert " --help" in done.stderr


def test_without_a_command_the_program_shows_its_help():
    done = lenscal()
    assert "lenscal demo" in done.stdout + done.stderr
