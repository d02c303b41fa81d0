"""A fresh frame is never older than its light, and waiting for one ends."""

import math
from dataclasses import replace

import pytest

from rig import Frame, RigConfig, open_rig
from rig.fresh_frame import FrameKind, NoFreshFrameError, fresh_frame, kind_of, next_fresh_frame
from tests.changed_frames import with_frames

SMALL = RigConfig().with_changes(camera={"width_px": 32, "height_px": 32})


@pytest.mark.parametrize("light", [None, 0, 3])
def test_a_fresh_frame_starts_after_the_light_has_settled(light: int | None) -> None:
    with open_rig(SMALL) as rig:
        rig.lights.select(1)
        rig.clock.sleep_s(1.0)  # fills the queue with frames under another light
        asked_s = rig.clock.now_s()
        frame = fresh_frame(rig, light)
        period_s = rig.camera.info.frame_period_s
        assert frame.exposure_start_s >= asked_s + SMALL.lights.settle_ms / 1e3
        assert rig.clock.now_s() - asked_s < 3.0 * period_s
        dark = fresh_frame(rig, None).pixels.mean()
        assert (frame.pixels.mean() > 1.5 * dark) == (light is not None)


def test_a_long_settle_time_is_waited_for() -> None:
    slow = SMALL.with_changes(lights={"settle_ms": 5000.0, "watchdog_ms": 10_000})
    with open_rig(slow) as rig:
        asked_s = rig.clock.now_s()
        assert fresh_frame(rig, 2).exposure_start_s >= asked_s + 5.0


@pytest.mark.parametrize(
    ("changes", "counts"),
    [
        ({"exposure_start_s": -1.0}, r"\(\d+ from before .*2\.\d s\).*time stamps"),
        ({"exposure_start_s": math.nan}, r"\(\d+ from before .*2\.\d s\)"),
        ({"is_corrupt": True}, r"\d+ corrupt .*2\.\d s\)"),
    ],
)
def test_waiting_for_a_fresh_frame_ends_with_the_counts_of_all_others(
    changes: dict[str, object], counts: str
) -> None:
    with open_rig(SMALL) as rig:
        asked_s = rig.clock.now_s()
        with pytest.raises(NoFreshFrameError, match=rf"no fresh frame .*{counts}"):
            fresh_frame(with_frames(rig, lambda frame: replace(frame, **changes)), 0)
        assert rig.clock.now_s() - asked_s < 3.0


def test_a_program_that_was_stopped_meanwhile_takes_the_frames_that_waited() -> None:
    with open_rig(SMALL) as rig:
        stops = iter([True])

        def kind_after_a_stop(frame: Frame, not_before_s: float) -> FrameKind:
            if next(stops, False):
                rig.clock.sleep_s(10.0)
                return FrameKind.STALE
            return kind_of(frame, not_before_s)

        asked_s = rig.clock.now_s()
        assert next_fresh_frame(rig, asked_s, kind_after_a_stop).exposure_start_s >= asked_s


@pytest.mark.parametrize("light", [None, 0, 3])
def test_a_camera_that_waits_for_triggers_gets_one(light: int | None) -> None:
    config = RigConfig().with_changes(
        camera={"width_px": 16, "height_px": 16}, lights={"synchronisation": "trigger"}
    )
    with open_rig(config) as rig:
        frame = fresh_frame(rig, light)
        for led in range(4):
            lit_s = rig.simulation.board.output_integral_s(
                led, frame.exposure_start_s, frame.exposure_end_s
            )
            expected_s = frame.exposure_end_s - frame.exposure_start_s if led == light else 0.0
            assert lit_s == pytest.approx(expected_s, rel=0.01)
        assert rig.lights.state().led is None
