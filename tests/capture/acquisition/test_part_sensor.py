"""Sets that the part sensor begins: as good as others, of the right frames, one attempt each."""

from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture import capture_set
from capture.acquisition.hardware_set import wait_for_part
from capture.base.errors import SetRejected
from classify.base.errors import InputError
from rig import CameraError, LightControllerError, Rig, open_rig
from tests.capture.acquisition.test_hardware_set import WRONG_LIGHT, config, wrong_light


@pytest.fixture(params=["strobe", "trigger"])
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    with open_rig(config(request.param)) as opened:
        yield opened


@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(arrives_s=st.floats(0.05, 2.0), delay_s=st.floats(0.0, 0.1))
def test_a_set_begins_with_the_part_and_has_the_right_light(rig, arrives_s, delay_s):
    rig.simulation.see_part(arrives_s)
    seen_s = rig.clock.now_s() + arrives_s
    part = wait_for_part(rig, delay_s)
    captured = capture_set(rig, part=part)
    assert wrong_light(rig, captured) < WRONG_LIGHT
    first = captured.metadata.images[-1].frames[0]  # the ambient image is exposed first
    latest_s = seen_s + delay_s + rig.config.sequence_plan.duration_s
    if captured.metadata.synchronisation == "trigger":
        latest_s = seen_s + delay_s + rig.config.sequence_plan.settle_us / 1e6 + 0.001
    assert seen_s + delay_s <= first.exposure_start_s <= latest_s
    assert rig.lights.state().led is None


def test_part_after_part_is_served(rig):
    for _ in range(5):
        rig.simulation.see_part(0.3)
        captured = capture_set(rig, part=wait_for_part(rig, 0.01))
        assert wrong_light(rig, captured) < WRONG_LIGHT
        capture_set(rig)  # by command, between two parts


def test_a_wait_longer_than_the_watchdog_is_kept_alive():
    with open_rig(config("trigger", lights={"watchdog_ms": 1000})) as rig:
        rig.simulation.see_part(3.0)
        assert wrong_light(rig, capture_set(rig, part=wait_for_part(rig, 0.0))) < WRONG_LIGHT


def test_a_wait_can_be_ended(rig):
    end_s = rig.clock.now_s() + 1.0
    assert wait_for_part(rig, 0.0, lambda: rig.clock.now_s() > end_s) is None
    assert rig.clock.now_s() < end_s + 1.0
    assert rig.lights.state().led is None
    capture_set(rig)


def test_after_a_failed_wait_the_controller_waits_no_longer(rig):
    def fails() -> bool:
        raise CameraError("unplugged")

    with pytest.raises(CameraError):
        wait_for_part(rig, 0.0, fails)
    rig.simulation.see_part(0.1)
    rig.clock.sleep_s(0.2)
    assert rig.lights.state().led is None
    rig.simulation.see_part(0.3)
    assert wrong_light(rig, capture_set(rig, part=wait_for_part(rig, 0.0))) < WRONG_LIGHT


def test_after_an_interrupted_write_the_controller_waits_no_longer(rig):
    def interrupted() -> bool:
        rig.lights._link._line.write(b"#9 LED:S")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        wait_for_part(rig, 0.0, interrupted)
    rig.simulation.see_part(0.1)
    rig.clock.sleep_s(0.2)
    assert rig.lights.state().led is None


def test_a_wait_that_the_controller_ends_is_an_error_and_no_part(rig):
    def put_out() -> bool:
        rig.lights.off()
        return False

    with pytest.raises(LightControllerError, match=r"the wait .* Sequence aborted"):
        wait_for_part(rig, 0.0, put_out)


@pytest.mark.parametrize("kind", ["dropped", "repeated_frame"])
def test_a_frame_that_is_lost_or_repeated_before_the_part_does_not_matter(kind):
    faults = {"frames": [{"kind": kind, "when": {"nth": 15}}]}
    with open_rig(config("strobe", simulation={"faults": faults})) as rig:
        rig.simulation.see_part(1.0)
        assert wrong_light(rig, capture_set(rig, part=wait_for_part(rig, 0.01))) < WRONG_LIGHT


@pytest.mark.parametrize("kind", ["dropped", "repeated_frame"])
def test_a_frame_that_is_lost_or_repeated_with_the_part_rejects_its_set(kind):
    """The set has frames 31 to 35, counted from 1."""
    for number in range(32, 35):
        faults = {"frames": [{"kind": kind, "when": {"nth": number}}]}
        with open_rig(config("strobe", simulation={"faults": faults})) as rig:
            rig.simulation.see_part(0.97)
            with pytest.raises(SetRejected):
                capture_set(rig, part=wait_for_part(rig, 0.0))


def test_lights_that_go_out_during_the_set_reject_it_without_another_attempt(rig):
    rig.simulation.see_part(0.2)
    part = wait_for_part(rig, 0.0)
    rig.lights.off()
    with pytest.raises((SetRejected, CameraError), match=r"ended at step|no frame"):
        capture_set(rig, part=part)


def test_a_rig_synchronised_by_software_cannot_wait_for_parts():
    with (
        open_rig(config("software")) as rig,
        pytest.raises(InputError, match=r"lights\.synchronisation"),
    ):
        wait_for_part(rig, 0.0)


def test_a_part_is_not_averaged(rig):
    rig.simulation.see_part(0.2)
    with pytest.raises(InputError, match="average is 2"):
        capture_set(rig, average=2, part=wait_for_part(rig, 0.0))
