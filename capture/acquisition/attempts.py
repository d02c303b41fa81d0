"""`capture_set`: attempts at a set until its light images pass all checks."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
import numpy.typing as npt

from capture.base.errors import SetRejected
from capture.base.utc_time import utc_text
from capture.calibration.lookup import check_setting, read_calibration
from capture.calibration.ps4cal import CalibrationFile
from capture.calibration.setting import Setting
from capture.sets.captured_set import CapturedSet
from capture.sets.image_checks import CheckedImages
from capture.sets.metadata import CameraRecord, LightingRecord, SetMetadata, image_noise
from capture.sets.ome_tiff import PixelHash
from classify import Calibration, InputError, Ps4rigError
from classify.lights.agreement import split_by_redundancy_sign
from classify.methods import checked_label
from rig import CameraInfo, HardwareError, Rig

from .fresh_frames import FrameHistory, light_name
from .hardware_set import ArrivedPart, images_in_sequence
from .light_checks import check_set, check_target, measured_levels
from .light_images import SetImage, images_under

# Largest number of averaged frames. Their sum is far below 32 bits.
MAX_AVERAGE = 1024
# A transient disturbance (a lost line, a torn frame) seldom affects two attempts; see the table
# that test_fault_matrix.py prints.
MAX_ATTEMPTS = 3
# Placeholder until the pixels are hashed; a set with it cannot be saved.
_NO_HASH = ""
# Read once, because reading it takes longer than switching a light.
_SOFTWARE_VERSION = version("ps4rig")


def capture_set(
    rig: Rig,
    label: str | None = None,
    *,
    average: int = 1,
    calibration: CalibrationFile | None = None,
    is_target: bool = False,
    part: ArrivedPart | None = None,
    exposed: Callable[[CapturedSet], None] = lambda _: None,
    least_level: float | None = None,
) -> CapturedSet:
    """Capture one set: an ambient image, and a light image under each LED.

    A frame counts only if its exposure began after the controller's acknowledgement and the settle
    time. After each frame the controller is asked whether the LED is still on. The light images
    are then checked, see `light_checks`. A failed attempt is repeated with a new link to the
    controller; the error of the last attempt is raised, or the first one if no link can be opened.
    All LEDs are off at the end, also after an error.

    Parameters
    ----------
    rig
        An open rig.
    label
        Class of the part, if known.
    average
        Frames per image. The mean of several is stretched to 16 bits.
    calibration
        Calibration of this rig at this setting; by default the one that its ``rig.toml`` names,
        except for a target. Only the checks apply it: the set has the camera's pixel values, and
        the hash of the calibration.
    is_target
        The part is a calibration target: no image is rejected for its brightness or shading.
    part
        Part that the sensor has detected, from `wait_for_part`, with `average` 1. Only one attempt
        is made, because another part may be there at a second one. A retake shows whether the part
        moved.
    exposed
        Called with the set of each attempt before its checks, to start work on its images; it must
        return at once. This set has no checks and no hash. The returned set has the same arrays,
        and the same metadata except corrected intensities.
    least_level
        Least share of the others' light at which an LED is accepted, if a retake confirms it; the
        intensities of the set have its measured level. By default a difference of 4 % is rejected.

    Raises
    ------
    InputError
        If the label is not printable, or average out of range.
    CalibrationError
        If the calibration is of another rig or setting.
    SetRejected
        If an image is saturated, dark or under the wrong light, or no fresh frame arrived.
    HardwareError
        If the controller or the camera fails.
    """
    if part is not None and average != 1:
        raise InputError(f"average is {average}; a part that the sensor saw has one frame an image")
    if not 1 <= average <= MAX_AVERAGE:
        raise InputError(f"average is {average}; it must be 1 to {MAX_AVERAGE} frames")
    if label is not None:
        checked_label(label)
    if calibration is None and rig.config.calibration is not None and not is_target:
        calibration = read_calibration(Path(rig.config.calibration))
    if calibration is not None:
        check_setting(calibration, Setting.of_rig(rig), "this rig")
    failures: list[Ps4rigError] = []
    while True:
        try:
            rig.lights.recover()
        except HardwareError as error:
            raise failures[0] if failures else error from None
        try:
            captured = _attempt(
                rig, label, average, calibration, is_target, failures, part, exposed, least_level
            )
            rig.lights.off()
            return captured
        except (SetRejected, HardwareError) as error:
            _leds_off(rig)
            if part is not None or len(failures) + 1 == MAX_ATTEMPTS:
                raise
            failures.append(error)
            _flush(rig)
        except BaseException:
            _leds_off(rig)
            raise


def _attempt(
    rig: Rig,
    label: str | None,
    average: int,
    calibration: CalibrationFile | None,
    is_target: bool,
    failures: Sequence[Ps4rigError],
    part: ArrivedPart | None,
    exposed: Callable[[CapturedSet], None],
    least_level: float | None,
) -> CapturedSet:
    """Capture and check a set once; `failures` are the errors of the earlier attempts."""
    created, info, config = datetime.now(UTC), rig.camera.info, rig.config
    history = FrameHistory(info.frame_period_s)
    pixel_hash = PixelHash()
    add_page = partial(_add_page, pixel_hash, len(rig.lighting))
    set_images = _capture(rig, average, history, add_page, part)
    camera = _camera_record(info)
    images = _images_to_check(rig, set_images, average, camera)
    ambient = next(image for image in set_images if image.record.light is None)
    at_exposure = (
        Calibration() if calibration is None else calibration.calibration.at(camera.exposure_ms)
    )
    placement = None if rig.simulation is None else rig.simulation.placement
    metadata = SetMetadata(
        label=label,
        created_utc=utc_text(created, timespec="milliseconds"),
        simulated=rig.is_simulated,
        bit_depth=info.bit_depth,
        full_scale=int(images.full_scale),
        lighting=LightingRecord.of(rig.lighting),
        images=tuple(image.record for image in (*_light_images(set_images), ambient)),
        orientation_deg=None if placement is None else placement.rotate_deg,
        placement=placement,
        rig_name=config.name,
        settle_ms=config.lights.settle_ms,
        synchronisation=config.lights.synchronisation,
        camera=camera,
        controller=rig.lights.identity,
        failed_attempts=tuple(map(str, failures)),
        calibration_ids=() if calibration is None else (calibration.hash,),
        mm_per_px=at_exposure.mm_per_px,
        software_version=_SOFTWARE_VERSION,
        pixels_sha256=_NO_HASH,
    )
    unchecked = CapturedSet(images.images, images.ambient, metadata, calibration=calibration)
    exposed(unchecked)
    retake = partial(_retake, rig, average, history)
    if is_target:
        checks = check_target(images)
    else:
        checks = check_set(images, at_exposure, retake, least_level)
    lighting = metadata.lighting
    levels = None if least_level is None else measured_levels(checks)
    if levels is not None:
        corrected = replace(rig.lighting, intensities=rig.lighting.intensities * levels)
        lighting = LightingRecord.of(corrected)
        checks = checks.model_copy(update={"levels_corrected": True})
    checked = {"checks": checks, "lighting": lighting, "pixels_sha256": pixel_hash.sha256()}
    return replace(
        unchecked,
        metadata=metadata.model_copy(update=checked),
        hashed=(unchecked.images, unchecked.ambient, None),
    )


def _images_to_check(
    rig: Rig, set_images: list[SetImage], average: int, camera: CameraRecord
) -> CheckedImages:
    ambient, *later_ambient = (image for image in set_images if image.record.light is None)
    bit_depth = rig.camera.info.bit_depth
    full_scale = (1 << bit_depth) - 1 if average == 1 else 65535
    return CheckedImages(
        _stack(_light_images(set_images)),
        ambient.pixels,
        later_ambient[0].pixels if later_ambient else None,
        rig.lighting,
        [light_name(rig, light) for light in range(len(rig.lighting))],
        full_scale,
        image_noise(camera.noise, bit_depth, full_scale, average),
    )


def _capture(
    rig: Rig,
    average: int,
    history: FrameHistory,
    on_image: Callable[[SetImage], None] = lambda _: None,
    part: ArrivedPart | None = None,
    *,
    is_retake: bool = False,
) -> list[SetImage]:
    """Ambient and light images in order of capture; a retake may lack ambient images."""
    if rig.config.sequence_plan is not None:
        images = images_in_sequence(rig, average, part)
        for image in images:
            on_image(image)
        return images
    # The two lights of each sign in the redundancy follow each other, with an ambient image between
    # the pairs. Extra light during consecutive images then changes the redundancy residual or that
    # ambient image.
    first, second = split_by_redundancy_sign(rig.lighting)
    order = (*first, *second)[::-1] if is_retake else (None, *first, None, *second)
    return images_under(rig, order, average, history, on_image)


def _retake(rig: Rig, average: int, history: FrameHistory) -> npt.NDArray[np.uint16]:
    """The light images of a second capture."""
    return _stack(_light_images(_capture(rig, average, history, is_retake=True)))


def _add_page(pixel_hash: PixelHash, light_count: int, image: SetImage) -> None:
    """Hash an image that the file holds: a light image or the first ambient image."""
    page = light_count if image.record.light is None else image.record.light
    is_later_ambient = page == light_count and pixel_hash.has(page)
    if not is_later_ambient:
        pixel_hash.add(page, image.pixels)


def _light_images(images: list[SetImage]) -> list[SetImage]:
    """The light images in the order of the lights."""
    by_light = {image.record.light: image for image in images if image.record.light is not None}
    return [by_light[light] for light in sorted(by_light)]


def _stack(images: list[SetImage]) -> npt.NDArray[np.uint16]:
    return np.stack([image.pixels for image in images])


def _leds_off(rig: Rig) -> None:
    # The caller must see the first error; if this fails too, the watchdog turns the LEDs off.
    with suppress(HardwareError):
        rig.lights.off()


def _flush(rig: Rig) -> None:
    """Empty the camera's buffers, so that no frame of this attempt reaches the next one."""
    info = rig.camera.info
    with suppress(HardwareError):
        for _ in range(info.queue_length + 1):
            rig.camera.read(info.queue_length * info.frame_period_s)


def _camera_record(info: CameraInfo) -> CameraRecord:
    timing = {"exposure_ms": 1000.0 * info.exposure_s, "frame_rate_hz": 1.0 / info.frame_period_s}
    others = {
        name: getattr(info, name) for name in CameraRecord.model_fields.keys() - timing.keys()
    }
    return CameraRecord(**others, **timing)
