"""`ps4rig rig init`, as a command."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from firmware_sim import RealClock, SimulatedBoard, SimulatedController, serve_pty

Command = Callable[..., Any]
Refused = Callable[..., str]


def test_the_written_file_works_with_other_commands(ps4rig: Command, tmp_path: Path) -> None:
    clock = RealClock()
    path = tmp_path / "rig.toml"
    with serve_pty(SimulatedController(SimulatedBoard(clock), clock)) as server:
        done = ps4rig("rig", "init", path, "--port", server.address)
        assert done.exit_code == 0, done.stderr
        assert "light controllers found: 1" in done.output
        path.write_text(path.read_text().replace("# device =", "device ="))
        assert ps4rig("rig", "lights", "off", "--rig", path).exit_code == 0


def test_an_existing_file_is_only_replaced_by_force(
    ps4rig: Command, refused: Refused, tmp_path: Path
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("mine")
    assert "exists already" in refused("rig", "init", path, "--port", "/dev/ttyNONE")
    assert path.read_text() == "mine"
    done = ps4rig("rig", "init", path, "--port", "/dev/ttyNONE", "--force")
    assert done.exit_code == 0
    assert "/dev/ttyNONE: no such port" in done.stderr
    assert "No light controller answered" in path.read_text()
