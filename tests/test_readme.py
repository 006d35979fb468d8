"""The README's commands are run, and what it prints is compared with what they print."""

import contextlib
import io
import re
import shlex
import sys
from pathlib import Path

import pytest

from lenscal.cli.main import main

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
#: How far a number may be from the README's: other processors round otherwise, and noise grows it.
_RELATIVE = 0.06
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def blocks(kind):
    return re.findall(rf"^```{kind}\n(.*?)^```$", README, re.DOTALL | re.MULTILINE)


def assert_alike(stated, printed):
    """Every stated line follows in what was printed, '...' standing for any lines."""
    lines = iter([line.strip() for line in printed.splitlines() if line.strip()])
    for line in (line.strip() for line in stated.splitlines() if line.strip()):
        if line == "...":
            continue
        assert any(_same(line, other) for other in lines), f"not printed: {line}\n{printed}"


def _same(stated, printed):
    if _NUMBER.sub("#", stated).split() != _NUMBER.sub("#", printed).split():
        return False
    pairs = zip(_NUMBER.findall(stated), _NUMBER.findall(printed), strict=True)
    return all(_near(float(a), float(b)) for a, b in pairs)


def _near(a, b):
    # What is zero but for rounding is compared by its size alone.
    return abs(a - b) <= _RELATIVE * max(abs(a), abs(b)) + 0.02 or max(abs(a), abs(b)) < 1e-9


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("readme")
    (path / "data").symlink_to(ROOT / "data")
    return path


def commands(block):
    for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
        command, _, output = part.partition("\n")
        yield command, output


def run(command):
    """Run a line as the program does, without its start; give status, output and errors."""
    words = shlex.split(command)
    output, errors, status = io.StringIO(), io.StringIO(), 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", words)
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
            try:
                main()
            except SystemExit as end:
                status = end.code
    return status, output.getvalue(), errors.getvalue()


@pytest.mark.parametrize("block", blocks("console"), ids=["session", "planning", "contradiction"])
def test_the_commands_print_what_the_readme_says(block, folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "100")
    for command, stated in commands(block):
        assert command.startswith("lenscal ")
        status, output, errors = run(command)
        failed = stated.startswith("lenscal: ")
        assert (status != 0) == failed, errors
        assert_alike(stated, errors if failed else output)


def test_the_program_prints_what_the_readme_says(monkeypatch):
    monkeypatch.chdir(ROOT)
    (program,) = blocks("python")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(program, "README.md", "exec"), {})
    following = README.split(program)[1].split("```text\n")[1].split("```")[0]
    assert_alike(following, printed.getvalue())


def test_the_first_two_shell_lines_make_their_own_environment():
    first, second = blocks("bash")[0].splitlines()
    for line in (first, second):
        assert line.startswith("python3 -m venv .venv && .venv/bin/pip install -q -e ")
    assert first.endswith("lenscal demo --out lenscal-demo")
    assert second.endswith(".ci/checks")


def test_what_the_readme_points_to_is_there():
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert [link for link in links if "://" not in link and not (ROOT / link).exists()] == []
