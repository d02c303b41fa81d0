"""Usage errors, pages of help and tables of the command line."""

import inspect
import sys
from collections.abc import Callable
from typing import Any, get_type_hints

import pytest
import typer
from typer.models import OptionInfo

from capture.cli import app, run

Command = Callable[..., Any]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no-such-command"], "no-such-command"),
        (["capture"], "OUT"),
        (["capture", "--average", "0", "a.ome.tif"], "--average"),
        (["capture", "--rig", "sim", "--rotate", "north", "a.ome.tif"], "--rotate"),
        (["import", "a.png", "--gamma", "2.2", "a.ome.tif"], "2.2"),
        (["solve", "a.ome.tif"], "--out"),
        (["solve", "a.ome.tif", "--out", "maps", "--method", "ps5"], "'ps3a', 'ps3b'"),
        (["classify", "--colour", "x"], "--colour"),
    ],
)
def test_wrong_usage_is_status_2_and_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: Any, arguments: list[str], message: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["ps4rig", *arguments])
    assert run() == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert line.startswith("ps4rig: ")
    assert message in line


def test_a_call_without_a_command_lists_all_commands(ps4rig: Command) -> None:
    page = ps4rig().stdout
    assert page == ps4rig("--help").stdout
    for name in ("demo", "capture", "import", "solve", "train", "classify", "evaluate", "rig"):
        assert name in page


def test_help_is_readable_on_a_narrow_terminal(
    spawn: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    stdout, _ = spawn("train", "--help").communicate(timeout=60)
    assert {"--library", "Texture", "library,", "NAME.ps4lib."} <= set(stdout.split())


_TABLE = """
from capture.base.console import new_table, print_table
table = new_table("set", "distance", "reason", prose="reason")
table.title = "Title"
table.add_row("[sets]/rock-001.ome.tif\\n(simulated)", "0.1234", REASON)
table.add_row(PATH, "12.5", "short")
print_table(table)
"""
_REASON = "rock is nearest, at 2.5 times its limit; teach more sets of it, or check the focus"


@pytest.mark.parametrize("path", ["a.ome.tif", "/a/long/folder/" * 8 + "a.ome.tif"])
def test_a_table_is_alike_on_every_terminal_and_in_a_pipe(run_python: Command, path: str) -> None:
    program = _TABLE.replace("REASON", repr(_REASON)).replace("PATH", repr(path))
    shown = {run_python(program, COLUMNS=columns) for columns in ("20", "80", "300")}
    (table,) = shown
    title, _, head, _, first, *more = table.splitlines()
    assert title == "Title"
    reason = head.index("reason")
    assert first.index("rock is") == reason
    assert next(line for line in more if "short" in line).index("short") == reason
    assert " ".join(line[reason:].strip() for line in [first, *more[:-1]]).split() == (
        f"{_REASON} short".split()
    )
    assert path in table
    assert all(len(line) <= 80 for line in table.splitlines()) == (len(path) < 80)


def test_a_long_line_is_not_broken(run_python: Command) -> None:
    line = "word " * 60 + "end"
    assert run_python(f"from capture.base.console import out; out.print({line!r})") == line + "\n"


def test_an_option_with_its_own_name_as_metavar_is_named() -> None:
    """Typer 0.27 makes ``--RIG`` of an option ``rig`` with the metavar ``RIG``."""
    assert _unnamed(app) == []


def _unnamed(group: typer.Typer) -> list[str]:
    found = []
    for command in group.registered_commands:
        assert command.callback is not None
        hints = get_type_hints(inspect.unwrap(command.callback), include_extras=True)
        for name, hint in hints.items():
            for info in getattr(hint, "__metadata__", ()):
                if isinstance(info, OptionInfo) and info.metavar == name.upper():
                    # Within Annotated, the first name is where the default would be.
                    is_named = info.param_decls or str(info.default).startswith("--")
                    found += [] if is_named else [name]
    for inner in group.registered_groups:
        assert inner.typer_instance is not None
        found += _unnamed(inner.typer_instance)
    return found
