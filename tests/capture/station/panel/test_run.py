"""`ps4rig station run` with its panel."""

import socket
from pathlib import Path
from typing import Any

import pytest

from capture.commands.station_interfaces import panel_settings, running_interfaces
from capture.station.domain.errors import CannotListen
from capture.station.domain.folder import StationFolder, make_station
from capture.station.domain.interface_config import PanelConfig
from capture.station.panel.server import panel_listener
from capture.station.run.live_socket import NAME
from capture.station.run.live_station import LiveStation
from classify.base.errors import ConfigError


def test_a_taken_port_stops_only_a_run_that_asked_for_the_panel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_station(tmp_path / "line-1")
    folder, live = StationFolder(tmp_path / "line-1"), LiveStation("line-1", simulated=True)
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        settings = folder.config.panel.model_copy(update={"port": port})
        object.__setattr__(folder.config, "panel", settings)
        with running_interfaces(folder, live, "timer", (), panel=None, host=None, port=None):
            said = capsys.readouterr().err
        assert f"warning: no panel: [panel] 127.0.0.1:{port}" in said
        with (
            pytest.raises(CannotListen, match="give another port with --port; --no-panel runs"),
            running_interfaces(folder, live, "timer", (), panel=True, host=None, port=None),
        ):
            pass
        with pytest.raises(CannotListen, match=r"give another port with --port$"):
            panel_listener(folder.path, settings)


def test_a_run_whose_panel_may_take_any_port_asked_for_the_panel(tmp_path: Path) -> None:
    make_station(tmp_path / "line-1")
    folder, live = StationFolder(tmp_path / "line-1"), LiveStation("line-1", simulated=True)
    (folder.path / NAME).mkdir()  # in the place of the socket
    with (
        pytest.raises(CannotListen),
        running_interfaces(folder, live, "timer", (), panel=None, host=None, port=0),
    ):
        pass


def test_the_command_line_changes_host_and_port_alone() -> None:
    configured = PanelConfig(port=8443, tls_cert="a", tls_key="b", names=("line-3.example",))
    changed = panel_settings(configured, "0.0.0.0", None)
    assert changed == configured.model_copy(update={"host": "0.0.0.0"})
    assert panel_settings(configured, None, 0).port == 0
    with pytest.raises(ConfigError, match=r"--host, --port: host.*give an IP address"):
        panel_settings(configured, "evil.example", None)


def test_an_unsafe_panel_ends_the_run_at_its_start(ps4rig: Any, tmp_path: Path) -> None:
    make_station(tmp_path / "line-1")
    done = ps4rig("station", "run", tmp_path / "line-1", "--host", "0.0.0.0", "--port", "0")
    assert done.exit_code == 2
    assert "other machines would send passwords in the clear" in done.stderr
    assert not (tmp_path / "line-1" / NAME).exists()


def test_a_run_without_a_panel_can_be_followed_by_one(tmp_path: Path) -> None:
    make_station(tmp_path / "line-1")
    folder, live = StationFolder(tmp_path / "line-1"), LiveStation("line-1", simulated=True)
    with running_interfaces(folder, live, "http", (), panel=False, host=None, port=None):
        assert (folder.path / NAME).is_socket()
    assert not (folder.path / NAME).exists()
