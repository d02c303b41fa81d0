"""The V4L2 layer on the kernel's test driver, vivid. Runs as root in the guest.

vivid stamps each frame most of a period after it hands it out, has no exposure control, and lists
some 80 formats, most of which ps4rig does not decode.
"""

import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from capture import CapturedSet, capture_set
from rig import CameraError, list_cameras
from rig.cameras.opencv import OpencvCamera
from rig.cameras.v4l2.camera import V4l2Camera
from rig.cameras.v4l2.controls import find_control, read_control, write_control
from rig.cameras.v4l2.device import V4l2Device
from rig.cameras.v4l2.pixel_formats import PIXEL_FORMATS

# The contract of every camera, but for the test that needs LEDs that the camera sees.
from tests.contract.test_camera_contract import (  # noqa: F401
    test_a_read_that_times_out_is_an_error_and_the_next_one_works,
    test_at_most_a_queue_of_frames_is_stale_after_a_pause,
    test_close_may_be_called_twice_and_ends_the_frames,
    test_frames_agree_with_the_camera_info,
    test_frames_come_in_order_of_exposure_one_period_apart,
    test_no_exposure_ends_in_the_future,
)
from tests.hil.guest.vivid_bench import (
    CID_BRIGHTNESS,
    CID_GAIN,
    DISCONNECTED,
    PERIOD_S,
    REMOVED,
    STEP,
    VIDEO,
    Bench,
    assert_fails_in_time,
    brightness_follows_the_leds,
    config,
    control_set,
    mean_period_s,
    named,
    opencv_config,
    press,
    without_loss,
)

pytestmark = pytest.mark.usefixtures("no_caption")


def test_known_and_unknown_formats_are_listed_with_their_sizes(device: V4l2Device) -> None:
    offered = {entry.fourcc: entry for entry in device.formats()}
    assert "320x180" in offered["GREY"].sizes
    known = {entry.fourcc for entry in PIXEL_FORMATS.values()}
    assert len(offered.keys() - known) > 10
    # vivid has all decoded formats but the compressed one.
    assert known - offered.keys() == {"MJPG"}


def test_a_streaming_camera_is_listed(camera: V4l2Camera) -> None:
    listed = {str(entry.node): entry for entry in list_cameras()}
    vivid = listed[VIDEO]
    assert (vivid.name, vivid.driver, vivid.problem) == ("vivid", "vivid", None)
    assert "GREY" in {text.split()[0] for text in vivid.formats}
    assert 'pixel_format = "Y16"' in vivid.config_lines
    assert not camera.read(2.0).is_corrupt


@pytest.mark.parametrize(
    "name", [entry.name for entry in PIXEL_FORMATS.values() if not entry.is_compressed]
)
def test_a_stream_in_every_format_has_true_depth_and_no_gaps(name: str) -> None:
    with closing(V4l2Camera(config(name, frame_rate_hz=25.0))) as camera:
        frames = without_loss(camera, 5)
    assert mean_period_s(frames) == pytest.approx(0.04, abs=0.01)
    depth = PIXEL_FORMATS[name].bit_depth
    assert {frame.pixels.shape for frame in frames} == {(180, 320)}
    # Colour bars: from black to three quarters of the range, also of luma's shorter range.
    pixels = frames[-1].pixels
    assert pixels.dtype == (np.uint8 if depth == 8 else np.uint16)
    assert pixels.min() < 0.1 * 2**depth
    assert 0.65 * 2**depth < pixels.max() < 2**depth


def test_all_grey_depths_show_the_same_image() -> None:
    means = {}
    for name in ("GREY", "Y10", "Y12", "Y16", "YUYV"):
        with closing(V4l2Camera(config(name))) as camera:
            pixels = camera.read(2.0).pixels
        means[name] = pixels.mean(axis=0) / 2 ** PIXEL_FORMATS[name].bit_depth
    for name in ("Y10", "Y12", "Y16"):
        np.testing.assert_allclose(means[name], means["GREY"], atol=1 / 256)


def test_white_in_luma_of_limited_range_is_saturated(device: V4l2Device) -> None:
    menu = named(device, "test_pattern").menu
    white = next(value for value, name in menu.items() if name == "100% White")
    with control_set(device, "test_pattern", white), closing(V4l2Camera(config("YUYV"))) as camera:
        assert camera.info.controls["v4l2"]["quantization"] != "full range"
        assert camera.read(2.0).pixels.min() == 255


def test_a_pause_shows_as_a_gap_after_the_queue(camera: V4l2Camera) -> None:
    camera.read(2.0)
    time.sleep(1.0)
    sequences = [camera.read(2.0).sequence for _ in range(camera.info.queue_length + 2)]
    gaps = np.diff(sequences)
    assert gaps.max() >= 3
    assert (gaps == 1).sum() >= camera.info.queue_length - 1


def test_lost_frames_leave_gaps_in_the_sequence(camera: V4l2Camera, device: V4l2Device) -> None:
    camera.close()
    with (
        control_set(device, "percentage_of_dropped_buffers", 50),
        closing(V4l2Camera(config(frame_rate_hz=25.0))) as lossy,
    ):
        sequences = [lossy.read(2.0).sequence for _ in range(20)]
    assert np.diff(sequences).max() > 1
    assert np.diff(sequences).min() >= 1


def test_a_faulty_frame_is_flagged_and_the_next_is_good(camera: V4l2Camera) -> None:
    camera.read(2.0)
    press(camera._device, "inject_v4l2_buf_flag_error")
    corrupt = [camera.read(2.0).is_corrupt for _ in range(6)]
    assert corrupt.count(True) == 1
    assert not corrupt[-1]


def test_a_driver_that_stops_for_good_is_an_error_in_time(camera: V4l2Camera) -> None:
    camera.read(2.0)
    press(camera._device, "inject_fatal_streaming_error")
    assert_fails_in_time(camera, r"/dev/video0: .*(stopped|no frame:|error)")


@pytest.mark.parametrize("source", [0, 1])
def test_the_source_of_time_stamps_is_read(device: V4l2Device, source: int) -> None:
    with control_set(device, "timestamp_source", source):
        device.set_format("GREY", 320, 180)
        device.claim(3)
        device.start()
        capture = device.next_capture(2.0)
    assert capture.marks_exposure_start == (source == 1)


def test_measurement_mode_is_set_and_recorded() -> None:
    with closing(V4l2Camera(config(gain=77))) as camera:
        info, controls = camera.info, camera.info.controls
    assert controls["gain_automatic"] == 0
    assert (info.gain, info.pixel_value_controls["brightness"]) == (77.0, 128.0)
    assert controls["v4l2"]["driver"] == "vivid"
    assert controls["v4l2"]["pixel_format"] == "GREY"
    assert not controls["v4l2"]["compressed"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gain": 300}, r"gain = 300 .* 0 to 255"),
        ({"gamma": 1}, r"no control .*gamma"),
        ({"fixed_exposure": False}, r"no control .*fixed_exposure = true"),
        ({"pixel_format": "MJPG", "allow_compressed": True}, r"MJPG 320x180 .*GREY"),
        ({"width_px": 322}, r"GREY 322x180 .* GREY 320x180"),
        ({"frame_rate_hz": 13.0}, r"frame_rate_hz = 13 was asked"),
    ],
)
def test_an_impossible_setting_is_refused_by_name(changes: dict[str, object], message: str) -> None:
    with pytest.raises(CameraError, match=message):
        V4l2Camera(config(**changes))


@pytest.mark.parametrize(
    ("slug", "value"),
    [
        ("brightness", 200),
        ("hue", -128),
        ("integer_64_bits", -(2**62)),
        ("menu", 4),
        ("integer_menu", 8),
        ("horizontal_flip", 1),
    ],
)
def test_every_kind_of_control_is_set(device: V4l2Device, slug: str, value: int) -> None:
    with control_set(device, slug, value):
        assert read_control(device, named(device, slug)) == value


@pytest.mark.parametrize(
    ("slug", "value", "message"),
    [
        ("brightness", 256, "brightness = 256 .* 0 to 255"),
        ("menu", 2, r"menu = 2 .*1 \(Menu Item 1\), 3"),
        ("read_only_integer_32_bits", 7, "control read_only_integer_32_bits is read-only"),
    ],
)
def test_a_control_that_cannot_be_set_is_named(
    device: V4l2Device, slug: str, value: int, message: str
) -> None:
    with pytest.raises(CameraError, match=message):
        write_control(device, named(device, slug), value)


def test_a_control_that_does_not_obey_is_named(device: V4l2Device) -> None:
    gain = find_control(device, CID_GAIN)
    assert gain is not None
    with (
        control_set(device, "gain_automatic", 1),
        pytest.raises(CameraError, match="gain was set to 255"),
    ):
        write_control(device, gain, 255)


def test_a_second_program_is_refused_and_changes_nothing(
    camera: V4l2Camera, device: V4l2Device
) -> None:
    before = camera.read(2.0)
    with pytest.raises(CameraError, match=r"/dev/video0: .*in use"):
        V4l2Camera(config("Y12", gain=9))
    brightness = find_control(device, CID_BRIGHTNESS)
    with pytest.raises(CameraError, match=r"brightness.*in use"):
        write_control(device, brightness, 3)
    after = camera.read(2.0)
    assert after.sequence > before.sequence
    assert not after.is_corrupt


def test_a_driver_that_fails_to_start_is_named_and_released(device: V4l2Device) -> None:
    press(device, "inject_vidioc_streamon_error")
    with pytest.raises(CameraError, match="/dev/video0: cannot start"):
        V4l2Camera(config())
    V4l2Camera(config()).close()


def test_a_set_holds_no_stale_frame(bench: Bench, tmp_path: Path) -> None:
    # Long enough to fill the driver's buffers with stale frames.
    time.sleep(6 * PERIOD_S)
    with brightness_follows_the_leds(bench):
        capture_set(bench.rig, label="bars").save(tmp_path / "bars.ome.tif")
    captured = CapturedSet.load(tmp_path / "bars.ome.tif")
    over_ambient = captured.images.mean(axis=(1, 2)) - captured.ambient.mean()
    np.testing.assert_allclose(over_ambient, STEP * np.array([1, 2, 3]), atol=1.0)
    metadata = captured.metadata
    # The controller is simulated.
    assert metadata.simulated
    assert (metadata.camera.kind, metadata.camera.name) == ("v4l2", "vivid")
    assert metadata.camera.controls["gain_automatic"] == 0
    assert metadata.camera.controls["v4l2"]["fixed_exposure"]
    assert sum(image.stale_frames for image in metadata.images) >= 2


def test_a_set_through_opencv_holds_no_stale_frame(opencv_bench: Bench) -> None:
    with brightness_follows_the_leds(opencv_bench):
        captured = capture_set(opencv_bench.rig, label="bars")
    over_ambient = captured.images.mean(axis=(1, 2)) - captured.ambient.mean()
    # OpenCV converts luma to grey through colours, and the bars are coloured.
    assert over_ambient[0] > 0.5 * STEP
    np.testing.assert_allclose(over_ambient / over_ambient[0], [1, 2, 3], rtol=0.15)
    camera = captured.metadata.camera
    assert camera.kind == "opencv"
    assert camera.controls["opencv"]["backend"] == "V4L2"


def test_opencv_is_refused_a_camera_whose_exposure_it_cannot_set() -> None:
    with pytest.raises(CameraError, match="auto_exposure was set to 1"):
        OpencvCamera(opencv_config(fixed_exposure=False))
    # The camera is released.
    V4l2Camera(config()).close()


# The checks below remove devices for good, so they come last.


def test_a_camera_that_is_disconnected_in_mid_stream_is_named_in_time() -> None:
    camera = V4l2Camera(config(device=DISCONNECTED))
    camera.read(2.0)
    press(camera._device, "disconnect")
    assert_fails_in_time(camera, "/dev/video1: the camera is gone")
    camera.close()
    camera.close()


def test_a_driver_that_is_unbound_in_mid_stream_is_named_in_time() -> None:
    camera = V4l2Camera(config(device=REMOVED))
    camera.read(2.0)
    Path("/sys/bus/platform/drivers/vivid/unbind").write_text("vivid.0")
    assert_fails_in_time(camera, "/dev/video2: the camera is gone")
    camera.close()
    with pytest.raises(CameraError, match="/dev/video2: no such camera"):
        V4l2Camera(config(device=REMOVED))
