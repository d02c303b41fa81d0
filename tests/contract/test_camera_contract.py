"""What every camera does, whatever is behind it.

OpenCV hands out no time stamps and no numbers. What it cannot do for that is asserted as its limit,
which ``rig/README.md`` states.
"""

import numpy as np
import pytest

from rig import CameraError, FrameFlag, Rig


def knows_when(rig: Rig) -> bool:
    """Whether the camera stamps its frames; else their time is bounded by when they came."""
    return rig.camera.info.kind != "opencv"


def test_frames_are_what_its_info_says(rig: Rig) -> None:
    info, frame = rig.camera.info, rig.camera.read(1.0)
    assert frame.pixels.shape == (info.height_px, info.width_px)
    assert frame.pixels.dtype == (np.uint8 if info.bit_depth == 8 else np.uint16)
    assert frame.bit_depth == info.bit_depth
    assert int(frame.pixels.max()) < 2**info.bit_depth
    assert frame.exposure_end_s - frame.exposure_start_s == pytest.approx(info.exposure_s, rel=0.01)
    assert frame.flags == FrameFlag.GOOD
    assert info.queue_length >= 1


def test_frames_come_in_the_order_of_their_exposure_one_period_apart(rig: Rig) -> None:
    frames = [rig.camera.read(1.0) for _ in range(8)]
    starts = np.diff([frame.exposure_start_s for frame in frames])
    sequences = np.diff([frame.sequence for frame in frames])
    if not knows_when(rig):
        assert (starts >= 0.0).all()
        # Numbered as they come: one that was lost is not missed.
        assert (sequences == 1).all()
        return
    assert (sequences >= 1).all()
    np.testing.assert_allclose(starts, sequences * rig.camera.info.frame_period_s, rtol=0.2)


def test_no_frame_comes_out_of_the_future(rig: Rig) -> None:
    for _ in range(8):
        assert rig.camera.read(1.0).exposure_end_s <= rig.clock.now_s()


def test_at_most_a_queue_of_frames_is_older_than_a_pause(rig: Rig) -> None:
    rig.camera.read(1.0)
    rig.clock.sleep_s(0.2)
    now_s = rig.clock.now_s()
    old = 0
    while rig.camera.read(1.0).exposure_start_s < now_s:
        old += 1
    # One more was being exposed at that time.
    longest = rig.camera.info.queue_length + 1
    # Without stamps a frame is new once as many came after the pause as may be older.
    assert 1 <= old <= (longest if knows_when(rig) else 2 * longest)


def test_a_frame_that_began_after_the_acknowledge_shows_the_new_light(rig: Rig) -> None:
    means = []
    for light in (None, 0, 2, None):
        switch = rig.lights.off() if light is None else rig.lights.select(light)
        not_before_s = switch.acknowledged_s + rig.config.lights.settle_ms / 1e3
        while (frame := rig.camera.read(1.0)).exposure_start_s < not_before_s:
            pass
        means.append(float(frame.pixels.mean()))
    assert means[1] > 2.0 * means[0]
    assert means[2] > 2.0 * means[0]
    assert means[3] == pytest.approx(means[0], rel=0.02)


def test_no_frame_in_time_is_an_error_and_the_next_one_still_comes(rig: Rig) -> None:
    def read_all() -> None:
        for _ in range(2 * rig.camera.info.queue_length):
            rig.camera.read(0.0005)

    with pytest.raises(CameraError, match="no frame"):
        read_all()
    assert rig.camera.read(1.0).flags == FrameFlag.GOOD


def test_close_may_be_called_again_and_ends_the_frames(rig: Rig) -> None:
    rig.camera.close()
    rig.camera.close()
    with pytest.raises(CameraError):
        rig.camera.read(1.0)
