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
        (["capture", "--average", "0", "a.ome.tif"], "--average"),
        (["capture", "--rig", "sim", "--rotate", "north", "a.ome.tif"], "--rotate"),
        (["import", "a.png", "--gamma", "2.2", "a.ome.tif"], "2.2"),
        (["solve", "a.ome.tif"], "--out"),
        (["solve", "a.ome.tif", "--out", "maps", "--method", "ps5"], "not one of 'ps3a', 'ps3b'"),
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
from capture.console import new_table, print_table
table = new_table("set", "reason", prose="reason")
table.title = "Title"
table.add_row("[sets]/rock-001.ome.tif\\n(simulated)", "rock is nearest")
print_table(table)
"""


def test_a_table_that_is_too_wide_is_printed_cell_by_cell(run_python: Command) -> None:
    assert "[sets]/rock-001.ome.tif  rock is" in run_python(_TABLE, COLUMNS="35")
    expected = "Title\nset: [sets]/rock-001.ome.tif (simulated)\nreason: rock is nearest\n\n"
    assert run_python(_TABLE, COLUMNS="20") == expected
