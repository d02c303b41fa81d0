"""Plans of sequences leave time to settle, or are refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.firmware import MAX_LINE_BYTES
from rig import ConfigError, RigConfig, open_rig
from rig.config.lights import REACTION_S, plan_sequence
from rig.lights.link import encode_command
from rig.lights.sequence import require_short_command, start_command

SMALL = {"width_px": 16, "height_px": 16}


def config(synchronisation: str = "strobe", **changes: dict[str, object]) -> RigConfig:
    lights = {"synchronisation": synchronisation, **changes.pop("lights", {})}
    camera = {**SMALL, **changes.pop("camera", {})}
    return RigConfig().with_changes(lights=lights, camera=camera, **changes)


@given(
    settle_ms=st.floats(0.0, 200.0),
    period_ms=st.floats(2.0, 200.0),
    exposed_share=st.floats(0.01, 0.7),
    triggers=st.booleans(),
)
def test_a_plan_leaves_time_to_settle(settle_ms, period_ms, exposed_share, triggers):
    exposed_s = exposed_share * period_ms / 1e3
    plan = plan_sequence(
        4,
        triggers=triggers,
        settle_s=settle_ms / 1e3,
        period_s=period_ms / 1e3,
        exposed_s=exposed_s,
    )
    assert plan.lights == (None, 0, 1, 2, 3)
    step_s = plan.wait_us / 1e6 if triggers else plan.frames_per_step * period_ms / 1e3
    assert step_s >= exposed_s + REACTION_S + settle_ms / 1e3 - 1e-9
    if not triggers and plan.frames_per_step > 1:  # and no more frames than needed
        assert step_s - period_ms / 1e3 < exposed_s + REACTION_S + settle_ms / 1e3
    assert start_command(plan).endswith(",-1,0,1,2,3")
    assert len(f"#65535 {start_command(plan)}~FF") <= 64


@given(
    lights=st.integers(4, 15),
    settle_ms=st.floats(0.0, 9000.0),
    triggers=st.booleans(),
)
def test_the_command_of_a_plan_fits_into_a_line(lights, settle_ms, triggers):
    plan = plan_sequence(
        lights, triggers=triggers, settle_s=settle_ms / 1e3, period_s=0.1, exposed_s=0.02
    )
    try:
        require_short_command(plan)
    except ConfigError as error:
        assert f"for {lights} lights" in str(error)  # noqa: PT017
        assert lights > 10
    else:
        longest_line = encode_command(65535, start_command(plan)).removesuffix(b"\n")
        assert len(longest_line) <= MAX_LINE_BYTES


def test_an_impossible_sequence_is_refused_with_its_numbers():
    with pytest.raises(ConfigError, match=r"33 ms of .* 33.33 ms.*no pause"):
        config(camera={"exposure_ms": 33.0})
    with pytest.raises(ConfigError, match=r"settle_ms = 5, .* 8.38 ms"):
        config(simulation={"led_rise_ms": 4.0})
    with pytest.raises(ConfigError, match=r"16 steps, .* 16 lights"):
        config(lights={"tilts_deg": [360.0 * n / 16 for n in range(16)]})
    with pytest.raises(ConfigError, match="more than 64 bytes"):
        open_rig(config(lights={"tilts_deg": [24.0 * n for n in range(15)]}))
    with pytest.raises(ConfigError, match=r"watchdog_ms = 200 .* 238 ms"):
        config(lights={"watchdog_ms": 200})
    with pytest.raises(ConfigError, match=r"needs to know.*camera.readout_ms"):
        config(
            lights={"port": "/dev/ttyACM0"},
            camera={"kind": "v4l2", "device": "/dev/video0", "bits": 8},
        )
    assert config("software", simulation={"led_rise_ms": 4.0}).sequence_plan is None


def test_a_long_settle_time_uses_every_second_frame():
    assert config(lights={"settle_ms": 12.0}).sequence_plan.frames_per_step == 1
    assert config(lights={"settle_ms": 13.0}).sequence_plan.frames_per_step == 2
    assert config(simulation={"readout_ms": 9.0}).sequence_plan.frames_per_step == 2
