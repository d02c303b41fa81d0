"""The first frame under a light: never one from before, and an end to the waiting."""

from dataclasses import replace

import pytest

from rig import Camera, CameraError, CameraInfo, Frame, FrameFlag, Rig, RigConfig, open_rig
from rig.fresh_frame import fresh_frame

SMALL = RigConfig().with_changes(camera={"width_px": 32, "height_px": 32})


class AlteredCamera:
    """A rig's camera whose frames say something else of themselves."""

    def __init__(self, camera: Camera, **changes: object) -> None:
        self.camera = camera
        self.changes = changes

    @property
    def info(self) -> CameraInfo:
        return self.camera.info

    def read(self, timeout_s: float) -> Frame:
        return replace(self.camera.read(timeout_s), **self.changes)

    def close(self) -> None:
        self.camera.close()


def altered(rig: Rig, **changes: object) -> Rig:
    return replace(rig, camera=AlteredCamera(rig.camera, **changes))


@pytest.mark.parametrize("light", [None, 0, 3])
def test_it_began_when_the_light_was_steady_and_came_without_delay(light: int | None) -> None:
    with open_rig(SMALL) as rig:
        rig.lights.select(1)
        rig.clock.sleep_s(1.0)  # the queue is full of frames under another light
        asked_s = rig.clock.now_s()
        frame = fresh_frame(rig, light)
        period_s = rig.camera.info.frame_period_s
        assert frame.exposure_start_s >= asked_s + SMALL.lights.settle_ms / 1e3
        assert rig.clock.now_s() - asked_s < 3.0 * period_s
        dark = fresh_frame(rig, None).pixels.mean()
        assert (frame.pixels.mean() > 1.5 * dark) == (light is not None)


def test_a_light_that_takes_long_to_settle_is_waited_for() -> None:
    slow = SMALL.with_changes(lights={"settle_ms": 5000.0, "watchdog_ms": 10_000})
    with open_rig(slow) as rig:
        asked_s = rig.clock.now_s()
        assert fresh_frame(rig, 2).exposure_start_s >= asked_s + 5.0


def test_time_stamps_of_another_clock_are_told_in_time() -> None:
    with open_rig(SMALL) as rig:
        asked_s = rig.clock.now_s()
        with pytest.raises(CameraError, match=r"\d+ frames came .* 0 of them corrupt.*time stamp"):
            fresh_frame(altered(rig, exposure_start_s=-1.0), 0)
        assert rig.clock.now_s() - asked_s < 3.0


def test_corrupt_frames_are_not_taken_and_counted() -> None:
    with (
        open_rig(SMALL) as rig,
        pytest.raises(CameraError, match=r"(\d+) frames came .* \1 of them corrupt"),
    ):
        fresh_frame(altered(rig, flags=FrameFlag.CORRUPT), 0)
