"""`capture_set` on the simulated rig: contents of a set, rejections and attempts."""

import math
import re
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from capture import CapturedSet, SetRejected, capture_set
from classify.base.errors import InputError
from rig import (
    CameraError,
    Frame,
    Placement,
    Rig,
    RigConfig,
    open_rig,
)
from rig.set_file import pixels_sha256
from tests.changed_frames import with_frames

Outputs = Callable[[Rig], list[float]]


@pytest.fixture
def rig(small_config: RigConfig, led_outputs: Outputs) -> Iterator[Rig]:
    """A rig whose LEDs must all be off after each test."""
    with open_rig(small_config) as opened:
        yield opened
        assert led_outputs(opened) == [0.0] * 4


def under(rig: Rig, led: int | None, action: Callable[[], object]) -> Rig:
    """Call `action` once, when a frame under `led` (None: no LED) is read."""
    done = False

    def change(frame: Frame) -> Frame:
        nonlocal done
        exposed_s, board = frame.exposure_end_s - 1e-3, rig.simulation.board
        lit = [other for other in range(4) if board.output(other, exposed_s) > 0.5]
        if not done and lit == ([] if led is None else [led]):
            done = True
            action()
        return frame

    return with_frames(rig, change)


# contents


def test_a_set_records_its_rig(rig: Rig) -> None:
    captured = capture_set(rig, label="oak")
    metadata = captured.metadata
    assert captured.label == "oak"
    assert metadata.simulated
    assert (metadata.bit_depth, metadata.full_scale) == (12, 4095)
    assert captured.lighting == rig.lighting
    assert metadata.placement == rig.config.simulation.placement
    assert metadata.orientation_deg == 0.0
    assert metadata.rig_name == "rig"
    assert metadata.controller.serial_number == "SIM-0001"
    assert metadata.camera.exposure_ms == pytest.approx(20.0)
    assert metadata.camera.frame_rate_hz == pytest.approx(30.0)
    assert captured.images.shape == (4, 64, 64)
    assert captured.ambient.shape == (64, 64)


def test_images_are_in_the_order_of_the_lights_then_ambient(rig: Rig) -> None:
    records = capture_set(rig).metadata.images
    assert [record.light for record in records] == [0, 1, 2, 3, None]
    # The ambient image is captured first, then opposite lights one after the other.
    starts = {record.light: record.frames[0].exposure_start_s for record in records}
    assert sorted(starts, key=lambda light: starts[light]) == [None, 0, 2, 1, 3]


@pytest.mark.parametrize("average", [1, 3])
@pytest.mark.parametrize(
    "camera", [{}, {"frame_rate_hz": 100.0, "exposure_ms": 10.0}, {"frame_rate_hz": 7.0}]
)
def test_every_exposure_starts_after_acknowledge_and_settle_time(
    small_config: RigConfig, camera: dict[str, float], average: int
) -> None:
    config = small_config.with_changes(camera=camera, lights={"settle_ms": 12.0})
    with open_rig(config) as rig:
        rig.clock.sleep_s(3.3)  # fills the queue with stale frames
        records = capture_set(rig, average=average).metadata.images
    stale = 0
    for record in records:
        assert len(record.frames) == average
        assert record.led_acknowledged_s is not None
        for frame in record.frames:
            assert frame.exposure_start_s >= record.led_acknowledged_s + 0.012
            assert frame.exposure_end_s - frame.exposure_start_s == pytest.approx(
                config.camera.exposure_ms / 1e3
            )
        numbers = [frame.sequence for frame in record.frames]
        assert numbers == list(range(numbers[0], numbers[0] + average))
        stale += record.stale_frames
    assert stale >= 5


def test_each_image_is_the_scene_under_its_light(rig: Rig) -> None:
    rig.simulation.place(Placement(surface="sand", rotate_deg=20.0, seed=3))
    captured = capture_set(rig)
    scene, sensor = rig.simulation.camera.scene, rig.simulation.camera.sensor
    assert captured.ambient is not None
    for image, light in [*zip(captured.images, scene.lights, strict=True), (captured.ambient, 0.0)]:
        electrons = 20.0 * sensor.white_e_per_ms * (light + scene.ambient)
        expected = sensor.black_level_dn + electrons / sensor.gain_e_per_dn
        noise = np.sqrt(electrons + sensor.read_noise_e**2) / sensor.gain_e_per_dn
        deviations = (image - expected) / noise
        assert abs(deviations.mean()) < 0.06  # 64 x 64 px: a standard error of 0.016
        assert deviations.std() == pytest.approx(1.0, abs=0.06)


# averages


def test_an_average_is_stretched_to_16_bits_and_its_noise_falls_with_the_root(rig: Rig) -> None:
    single, mean = ([capture_set(rig, average=count) for _ in range(2)] for count in (1, 16))
    assert [each[0].metadata.full_scale for each in (single, mean)] == [4095, 65535]
    assert mean[0].metadata.bit_depth == 12
    (a, b), (c, d) = (
        [one.images / one.metadata.full_scale for one in two] for two in (single, mean)
    )
    np.testing.assert_allclose(c.mean(axis=(1, 2)), a.mean(axis=(1, 2)), rtol=5e-3)
    assert (c - d).std() == pytest.approx((a - b).std() / 4.0, rel=0.05)


def test_a_pixel_that_saturated_in_one_frame_is_saturated_in_the_mean(rig: Rig) -> None:
    def one_flash(frame: Frame) -> Frame:
        pixels = frame.pixels.copy()
        pixels[3, 5] = 4095 if frame.sequence % 3 == 0 else 100
        return replace(frame, pixels=pixels)

    captured = capture_set(with_frames(rig, one_flash), average=6)
    assert (captured.images[:, 3, 5] == 65535).all()
    assert captured.solve().saturated.sum() == 1


@pytest.mark.parametrize("average", [0, -1, 1025])
def test_an_average_out_of_range_is_refused(rig: Rig, average: int) -> None:
    with pytest.raises(InputError, match=f"average is {average}"):
        capture_set(rig, average=average)


# rejected sets; all LEDs are off after each


OFF_CLOCK = "time stamps are not on the rig's clock"
BAD_FRAMES: dict[str, tuple[Callable[[Frame], Frame], type[Exception], str]] = {
    "corrupt": (lambda f: replace(f, is_corrupt=True), SetRejected, "corrupt"),
    "then corrupt": (
        lambda f: replace(f, is_corrupt=f.sequence > 4),
        SetRejected,
        "corrupt",
    ),
    "stale": (lambda f: replace(f, exposure_start_s=0.0), SetRejected, "from before"),
    "repeated": (lambda f: replace(f, sequence=7), SetRejected, "repeated"),
    "of another size": (lambda f: replace(f, pixels=f.pixels[:-1]), CameraError, "64 x 63 px"),
    "stamped in the future": (lambda f: f.shifted(0.05), CameraError, OFF_CLOCK),
    "stamped NaN": (lambda f: f.shifted(math.nan), CameraError, OFF_CLOCK),
    "that ends before it starts": (
        lambda f: replace(f, exposure_start_s=f.exposure_end_s + 0.01),
        CameraError,
        OFF_CLOCK,
    ),
}


@pytest.mark.parametrize(("change", "error", "message"), BAD_FRAMES.values(), ids=BAD_FRAMES)
def test_bad_frames_end_a_set_with_their_cause(
    rig: Rig, change: Callable[[Frame], Frame], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        capture_set(with_frames(rig, change))


def test_corrupt_frames_are_left_out_and_counted(rig: Rig) -> None:
    broken: list[int] = []

    def corrupt_fresh_ones(frame: Frame) -> Frame:
        if frame.sequence % 4 == 0:
            broken.append(frame.sequence)
            return replace(frame, pixels=frame.pixels * 0, is_corrupt=True)
        return frame

    captured = capture_set(with_frames(rig, corrupt_fresh_ones), average=8)
    records = captured.metadata.images
    used = {frame.sequence for record in records for frame in record.frames}
    assert not used & set(broken)
    assert sum(record.corrupt_frames for record in records) >= 5


def test_lost_frames_are_recorded(rig: Rig) -> None:
    def renumbered(frame: Frame) -> Frame:
        return replace(frame, sequence=3 * frame.sequence)

    records = capture_set(with_frames(rig, renumbered), average=3).metadata.images
    # Two gaps between three frames, and perhaps the gap before the first.
    assert all(record.lost_frames in (4, 6) for record in records)


def test_a_frame_repeated_by_its_pixels_is_not_lost(rig: Rig) -> None:
    before: list[Frame] = []

    def sometimes_repeated(frame: Frame) -> Frame:
        repeats = frame.sequence % 5 == 0 and len(before) > 0
        frame = replace(frame, pixels=before[-1].pixels) if repeats else frame
        before.append(frame)
        return frame

    records = capture_set(with_frames(rig, sometimes_repeated), average=8).metadata.images
    assert sum(record.repeated_frames for record in records) >= 5
    assert [record.lost_frames for record in records] == [0] * len(records)


def test_the_level_of_each_led_is_recorded(rig: Rig) -> None:
    rig.lights.set_level(1, 97)
    records = capture_set(rig).metadata.images
    assert [record.led_level_percent for record in records] == [100, 97, 100, 100, None]


def test_frames_lost_before_the_switch_are_not_counted(rig: Rig) -> None:
    rig.clock.sleep_s(3.0)
    assert all(record.lost_frames == 0 for record in capture_set(rig).metadata.images)


def test_each_attempt_shows_its_images_before_they_are_checked(rig: Rig) -> None:
    exposed: list[CapturedSet] = []

    def exchange() -> None:
        rig.simulation.place(Placement(surface="malv"))

    captured = capture_set(under(rig, 1, exchange), exposed=exposed.append)
    assert len(exposed) == len(captured.metadata.failed_attempts) + 1 == 2
    assert captured.images is exposed[-1].images
    assert captured.ambient is exposed[-1].ambient
    assert all(each.metadata.checks is None for each in exposed)
    with pytest.raises(InputError, match="pixels_sha256"):
        exposed[-1].save("unchecked.ome.tif")
    checked = {"checks": captured.metadata.checks, "pixels_sha256": captured.metadata.pixels_sha256}
    assert exposed[-1].metadata.model_copy(update=checked) == captured.metadata
    assert captured.metadata.checks is not None
    # The hash is that of the last attempt, whose images came one by one.
    assert captured.metadata.pixels_sha256 == pixels_sha256(captured.images, captured.ambient)


def test_a_second_attempt_follows_a_tripped_watchdog(rig: Rig) -> None:
    def hang() -> None:
        rig.simulation.clock.keep_alive_with(None)  # stops the keep-alive
        rig.clock.sleep_s(5.5)

    (cause,) = capture_set(under(rig, 1, hang)).metadata.failed_attempts
    assert re.search(r"LED \d should be lit.*Watchdog", cause)


@pytest.mark.parametrize("led", [None, 0, 1, 3])
@pytest.mark.parametrize("error", [RuntimeError, MemoryError, KeyboardInterrupt])
def test_after_any_exception_the_leds_are_off_and_the_next_set_is_accepted(
    rig: Rig, led: int | None, error: type[BaseException], led_outputs: Outputs
) -> None:
    def fail() -> None:
        if error is KeyboardInterrupt:
            signal.raise_signal(signal.SIGINT)
        raise error

    with pytest.raises(error):
        capture_set(under(rig, led, fail))
    assert led_outputs(rig) == [0.0] * 4
    assert capture_set(rig).metadata.failed_attempts == ()


def test_a_light_slot_is_repeated_if_its_frame_is_late(small_config: RigConfig) -> None:
    def captured_with(frames: list[dict[str, object]]) -> CapturedSet:
        plan = {"faults": {"frames": frames}}
        with open_rig(small_config.with_changes(simulation=plan)) as rig:
            return capture_set(rig)

    def signals(captured: CapturedSet) -> np.ndarray:
        return captured.images.mean(axis=(1, 2)) - captured.ambient.mean()

    clean, later = captured_with([]), []
    for number in range(2, 7):
        captured = captured_with([{"kind": "dropped", "when": {"nth": number}}])
        assert captured.metadata.failed_attempts == ()
        np.testing.assert_allclose(signals(captured), signals(clean), rtol=0.01)
        for image in captured.metadata.images:
            assert image.led_acknowledged_s is not None
            (frame,) = image.frames
            assert frame.exposure_start_s >= image.led_acknowledged_s + 0.005
        frames = [image.frames[0].sequence for image in captured.metadata.images]
        later.append(max(frames) - min(frames))
    assert max(later) > 5


@pytest.mark.parametrize("led", [None, 0, 3])
def test_a_second_attempt_follows_a_camera_error(rig: Rig, led: int | None) -> None:
    def fail() -> None:
        raise CameraError("no frame")

    assert capture_set(under(rig, led, fail)).metadata.failed_attempts == ("no frame",)


def test_the_third_camera_error_is_raised(rig: Rig) -> None:
    count = 0

    def fail(_frame: Frame) -> Frame:
        nonlocal count
        count += 1
        raise CameraError(f"frame {count} is gone")

    with pytest.raises(CameraError, match="frame 5 is gone"):  # two more reads flush the queue
        capture_set(with_frames(rig, fail))
