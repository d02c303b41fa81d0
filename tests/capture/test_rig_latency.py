"""`ps4rig rig latency`, as a command on a simulated rig."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig import load_config

Command = Callable[..., Any]
Refused = Callable[..., str]
BENCH = """\
# comment
[lights]
port = "simulated"

[camera]
width_px = 32     # small
height_px = 32
exposure_ms = 20  # not longer

[simulation]
stamp_lag_ms = 24
led_rise_ms = 4
"""


@pytest.fixture
def bench(in_folder: Path) -> Path:
    path = in_folder / "rig.toml"
    path.write_text(BENCH)
    return path


def test_the_timing_is_stored_and_used_by_capture(ps4rig: Command, bench: Path) -> None:
    output = ps4rig("rig", "latency", "--steps", "12").output
    assert "stored in rig.toml" in output
    kept = [line for line in bench.read_text().splitlines() if line in BENCH.splitlines()]
    assert kept == BENCH.splitlines()
    config = load_config(bench)
    # The frame ends 4 ms before the stamp. A rise of 4 ms takes 13 ms to within a thousandth.
    assert config.camera.timestamp_offset_ms == pytest.approx(-4.0, abs=1.0)
    assert config.camera.timing_measured_at == config.camera.mode
    assert 11.0 < config.lights.settle_ms < 16.0
    assert ps4rig("capture", "a.ome.tif").exit_code == 0
    # A second measurement gives the same values, not a correction to them.
    again = json.loads(ps4rig("rig", "latency", "--steps", "12", "--json").output)
    assert again["camera"]["timestamp_offset_ms"] == pytest.approx(
        config.camera.timestamp_offset_ms, abs=0.1
    )


def test_a_dry_run_stores_nothing(ps4rig: Command, bench: Path) -> None:
    found = json.loads(ps4rig("rig", "latency", "--steps", "12", "--dry-run", "--json").output)
    assert found["stored"] is None
    assert found["changes"]["camera"] == found["camera"]
    assert found["changes"]["lights"]["settle_ms"] == found["settle_ms"]
    assert bench.read_text() == BENCH


def test_an_unknown_led_is_refused(refused: Refused, bench: Path) -> None:
    assert bench.exists()
    assert "--led 4: lights.tilts_deg" in refused("rig", "latency", "--led", "4")
