"""`ps4rig rig timing`: sets by software and by the controller, compared with the limit."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.acquisition.timing import compared_configs, measure_set_timing
from rig import RigConfig

SMALL = RigConfig().with_changes(camera={"width_px": 16, "height_px": 16})
SIMULATED = [config for config in compared_configs(SMALL) if config.simulation.clock == "virtual"]


def test_a_simulated_rig_is_timed_in_all_modes():
    modes = {
        (c.simulation.clock, c.camera.frame_rate_hz, c.lights.synchronisation)
        for c in compared_configs(SMALL)
    }
    assert len(modes) == 2 * 2 * 3


def test_a_real_rig_is_timed_as_it_is_configured():
    lights = {"port": "/dev/ttyACM0"}
    camera = {"kind": "v4l2", "device": "/dev/video0", "bits": 8, "readout_ms": 0.0}

    def modes(synchronisation: str) -> list[str]:
        config = RigConfig().with_changes(
            lights={**lights, "synchronisation": synchronisation}, camera=camera
        )
        return [one.lights.synchronisation for one in compared_configs(config)]

    assert modes("software") == ["software"]
    assert modes("strobe") == ["software", "strobe"]
    assert modes("trigger") == ["trigger"]


@pytest.mark.parametrize("config", SIMULATED, ids=lambda c: c.lights.synchronisation)
def test_a_sequence_takes_its_frames_and_the_wait_for_the_first(config):
    timing = measure_set_timing(config, sets=3)
    assert (timing.accepted, timing.rejected, timing.clock) == (3, 0, "virtual")
    period_ms = 1e3 / config.camera.frame_rate_hz
    assert timing.limit_ms == pytest.approx(5 * period_ms)
    assert timing.exposures_ms is not None
    assert timing.worst_ms is not None
    if timing.synchronisation == "software":
        assert timing.worst_ms <= 14 * period_ms  # a second ambient image among them
    else:
        assert timing.exposures_ms <= timing.limit_ms
        assert timing.worst_ms <= timing.limit_ms + 1.3 * period_ms
    if timing.synchronisation == "strobe":
        assert timing.switch_ms is not None
        assert 0.0 < timing.switch_ms <= 0.2


@pytest.mark.slow
def test_the_command_prints_json_and_a_table(ps4rig: Callable[..., Any], in_folder: Path) -> None:
    (in_folder / "rig.toml").write_text(
        '[lights]\nport = "simulated"\n[camera]\nwidth_px = 16\nheight_px = 16\n'
    )
    arguments = ("rig", "timing", "--sets", 1)
    result = ps4rig(*arguments, "--json")
    assert result.exit_code == 0, result.output
    timings = json.loads(result.stdout)
    assert len(timings) == 12
    assert {timing["synchronisation"] for timing in timings} == {"software", "strobe", "trigger"}
    page = ps4rig(*arguments).output
    assert "trigger" in page
    assert "rejected" in page
