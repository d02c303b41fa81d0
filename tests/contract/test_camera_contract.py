"""What every kind of camera does.

OpenCV gives frames no time stamps and no sequence numbers. The limits that follow, stated in
``rig/README.md``, are asserted here.
"""

import numpy as np
import pytest

from rig import CameraError, Rig
from rig.cameras.camera import EXPOSURE_LAG_FRAMES

TIMEOUT_S = 20.0
# Share of full scale, rig/simulation/sensor.py.
SIMULATED_BLACK = 1 / 64


def has_stamps(rig: Rig) -> bool:
    """Whether the camera stamps its frames; otherwise their arrival bounds their time."""
    return rig.camera.info.kind != "opencv"


def black_level(rig: Rig) -> float:
    """Value of a pixel without light; GenICam has no standard feature that states it."""
    info = rig.camera.info
    return (
        SIMULATED_BLACK * 2**info.bit_depth
        if info.kind == "genicam"
        else info.black_level_dn or 0.0
    )


def test_frames_agree_with_the_camera_info(rig: Rig) -> None:
    info, frame = rig.camera.info, rig.camera.read(TIMEOUT_S)
    assert frame.pixels.shape == (info.height_px, info.width_px)
    assert frame.pixels.dtype == (np.uint8 if info.bit_depth == 8 else np.uint16)
    assert frame.bit_depth == info.bit_depth
    assert int(frame.pixels.max()) < 2**info.bit_depth
    assert frame.exposure_end_s - frame.exposure_start_s == pytest.approx(info.exposure_s, rel=0.01)
    assert not frame.is_corrupt
    assert info.queue_length >= 1


def test_frames_come_in_order_of_exposure_one_period_apart(rig: Rig) -> None:
    frames = [rig.camera.read(TIMEOUT_S) for _ in range(8)]
    starts = np.diff([frame.exposure_start_s for frame in frames])
    sequences = np.diff([frame.sequence for frame in frames])
    if not has_stamps(rig):
        assert (starts >= 0.0).all()
        # Frames are numbered as they arrive, so a lost frame leaves no gap.
        assert (sequences == 1).all()
        return
    assert (sequences >= 1).all()
    np.testing.assert_allclose(starts, sequences * rig.camera.info.frame_period_s, rtol=0.2)


def test_no_exposure_ends_in_the_future(rig: Rig) -> None:
    for _ in range(8):
        assert rig.camera.read(TIMEOUT_S).exposure_end_s <= rig.clock.now_s()


def test_at_most_a_queue_of_frames_is_stale_after_a_pause(rig: Rig) -> None:
    rig.camera.read(TIMEOUT_S)
    rig.clock.sleep_s(0.2)
    now_s = rig.clock.now_s()
    stale = 0
    while rig.camera.read(TIMEOUT_S).exposure_start_s < now_s:
        stale += 1
    # One more frame was being exposed at that time.
    longest = rig.camera.info.queue_length + 1
    # Without stamps, as many fresh frames as there may be stale ones are taken for stale.
    assert 1 <= stale <= (longest if has_stamps(rig) else 2 * longest)


def test_a_frame_begun_after_the_acknowledge_shows_the_new_light(rig: Rig) -> None:
    means = []
    for light in (None, 0, 2, None):
        switch = rig.lights.off() if light is None else rig.lights.select(light)
        not_before_s = switch.acknowledged_s + rig.config.lights.settle_ms / 1e3
        while (frame := rig.camera.read(TIMEOUT_S)).exposure_start_s < not_before_s:
            pass
        means.append(float(frame.pixels.mean()))
    assert means[1] > 2.0 * means[0]
    assert means[2] > 2.0 * means[0]
    assert means[3] == pytest.approx(means[0], rel=0.02)


def test_a_read_that_times_out_is_an_error_and_the_next_one_works(rig: Rig) -> None:
    def read_all() -> None:
        # More often than frames can wait, also while the machine is busy.
        for _ in range(20 * rig.camera.info.queue_length):
            rig.camera.read(0.0005)

    with pytest.raises(CameraError, match="no frame"):
        read_all()
    assert not rig.camera.read(TIMEOUT_S).is_corrupt


def test_close_may_be_called_twice_and_ends_the_frames(rig: Rig) -> None:
    rig.camera.close()
    rig.camera.close()
    with pytest.raises(CameraError):
        rig.camera.read(TIMEOUT_S)


def test_the_exposure_can_be_changed_within_the_range_of_the_camera(rig: Rig) -> None:
    camera = rig.camera
    shortest_ms, longest_ms = camera.exposure_range_ms
    configured_ms = 1e3 * camera.info.exposure_s
    assert shortest_ms <= configured_ms <= longest_ms
    with pytest.raises(CameraError, match=r"the camera takes .* ms"):
        camera.set_exposure(1.5 * longest_ms)
    rig.lights.select(0)
    half_ms = max(shortest_ms, 0.5 * configured_ms)
    levels = []
    for exposure_ms in (configured_ms, half_ms, configured_ms):
        camera.set_exposure(exposure_ms)
        assert camera.info.exposure_s == pytest.approx(exposure_ms / 1e3)
        for _ in range(camera.info.queue_length + EXPOSURE_LAG_FRAMES + 1):
            frame = camera.read(TIMEOUT_S)
        levels.append(float(frame.pixels.mean()) - black_level(rig))
    if half_ms < configured_ms:
        assert levels[1] == pytest.approx(0.5 * levels[0], rel=0.02)
    assert levels[2] == pytest.approx(levels[0], rel=0.02)
