"""`ps4rig rig doctor`, as a command."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

Command = Callable[..., Any]

SMALL = "[lights]\nport = 'simulated'\n[camera]\nwidth_px = 160\nheight_px = 160\n"


def test_a_rig_without_faults_has_a_page_with_status_0(ps4rig: Command, tmp_path: Path) -> None:
    config = tmp_path / "rig.toml"
    config.write_text(SMALL)
    page = ps4rig("rig", "doctor", "--rig", config)
    assert page.exit_code == 0
    for word in ("watchdog", "switch latency", "LED order", "fault: 0"):
        assert word in page.output


def test_a_fault_has_status_1_and_json_names_it(ps4rig: Command, tmp_path: Path) -> None:
    config = tmp_path / "rig.toml"
    config.write_text(SMALL + "[[simulation.faults.leds]]\nkind = 'dead'\nled = 3\n")
    done = ps4rig("rig", "doctor", "--rig", config, "--json")
    assert done.exit_code == 1
    found = json.loads(done.output)
    assert found["fault"] >= 1
    (led,) = (check for check in found["checks"] if check["name"] == "LED 3")
    assert led["status"] == "fault"
    assert "wiring" in led["advice"]
