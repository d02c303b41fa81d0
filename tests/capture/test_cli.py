"""Usage errors, pages of help and tables of the command line."""

import sys
from collections.abc import Callable
from typing import Any

import pytest

from capture.cli import run

Command = Callable[..., Any]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no-such-command"], "no-such-command"),
        (["capture"], "OUT"),
        (["import", "a.png", "--gamma", "2.2", "a.ome.tif"], "2.2"),
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


def test_prose_beside_wide_columns_has_forty_characters_a_line(run_python: Command) -> None:
    program = _TABLE.replace("REASON", repr(_REASON)).replace("PATH", repr("a" * 70))
    _, _, head, _, first, *more = run_python(program).splitlines()
    lines = [line[head.index("reason") :].strip() for line in (first, *more[:-2])]
    assert max(map(len, lines)) <= 41  # rich 13 gives the column one more
    assert len(lines) <= 3


def test_a_long_line_is_not_broken(run_python: Command) -> None:
    line = "word " * 60 + "end"
    assert run_python(f"from capture.base.console import out; out.print({line!r})") == line + "\n"
