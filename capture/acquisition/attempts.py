"""`capture_set`: pictures under each light in turn, checked, and taken again where that helps."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np
import numpy.typing as npt

from capture.errors import SetRejected
from capture.sets.captured_set import CapturedSet
from capture.sets.metadata import (
    CameraRecord,
    ChecksRecord,
    ControllerRecord,
    ImageRecord,
    LightingRecord,
    SetMetadata,
    image_noise,
)
from capture.sets.ome_tiff import pixels_sha256
from classify.errors import InputError, Ps4rigError
from classify.labels import checked_label
from classify.lights.agreement import like_signed
from rig import CameraInfo, HardwareError, Rig

from .fresh_frames import FrameBeat, light_name
from .hardware_set import images_in_sequence
from .light_checks import Pictures, check_ambient, check_lights
from .light_images import LightImage, images_under
from .quality import check_images

__all__ = ["MAX_AVERAGE", "MAX_RETRIES", "capture_set"]

MAX_AVERAGE = 1024
# How often a set is begun again before its last failure counts.
MAX_RETRIES = 2


def capture_set(rig: Rig, label: str | None = None, *, average: int = 1) -> CapturedSet:
    """One set: an ambient image, and one image under each LED.

    A frame counts only if its exposure began after the controller's acknowledge plus the settle
    time; what the camera's driver still had in its queue is thrown away. After each frame the
    controller is asked whether that LED is still the one lit. Then the pictures are checked, see
    `light_checks`. What fails is begun again, with the link to the controller made anew, and fails
    for good the third time. The LEDs are put out at the end, and when anything is raised.

    Parameters
    ----------
    rig
        An open rig.
    label
        The class of the part, where it is known.
    average
        Frames per image. The mean of several is kept at the full 16 bits.

    Raises
    ------
    InputError
        If the label is not printable, or average out of range.
    SetRejected
        If an image is saturated or dark, shows wrong light, or no fresh frame came; with its cause.
    HardwareError
        If the controller or the camera fails.
    """
    if not 1 <= average <= MAX_AVERAGE:
        raise InputError(f"average is {average}; it must be 1 to {MAX_AVERAGE} frames")
    if label is not None:
        checked_label(label)
    failures: list[Ps4rigError] = []
    while True:
        created = datetime.now(UTC)
        try:
            rig.lights.recover()
        except HardwareError as error:
            raise failures[0] if failures else error from None
        try:
            taken = _taken(rig, average)
            rig.lights.off()
            break
        except (SetRejected, HardwareError) as error:
            _put_out(rig)
            if len(failures) == MAX_RETRIES:
                raise
            failures.append(error)
            _flush(rig)
        except BaseException:
            _put_out(rig)
            raise
    info = rig.camera.info
    placement = None if rig.simulation is None else rig.simulation.placement
    metadata = SetMetadata(
        label=label,
        created_utc=created.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        simulated=rig.simulation is not None or rig.lights.identity.is_simulated,
        bit_depth=info.bit_depth,
        full_scale=taken.pictures.full_scale,
        lighting=LightingRecord.of(rig.lighting),
        images=taken.records,
        orientation_deg=None if placement is None else placement.rotate_deg,
        placement=placement,
        rig_name=rig.config.name,
        settle_ms=rig.config.lights.settle_ms,
        synchronisation=rig.config.lights.synchronisation,
        camera=_camera_record(info),
        controller=ControllerRecord(**asdict(rig.lights.identity)),
        checks=taken.checks,
        failed_attempts=tuple(map(str, failures)),
        software_version=version("ps4rig"),
        pixels_sha256=pixels_sha256(taken.pictures.images, taken.pictures.ambient),
    )
    return CapturedSet(taken.pictures.images, taken.pictures.ambient, metadata)


@dataclass(frozen=True, eq=False)
class _Taken:
    """Pictures that passed, their records in the same order and the ambient image's, and why."""

    pictures: Pictures
    records: tuple[ImageRecord, ...]
    checks: ChecksRecord


@dataclass(frozen=True, eq=False)
class _Look:
    """The ambient image, those of the lights in their order, and perhaps a later ambient image."""

    ambient: LightImage
    lights: tuple[LightImage, ...]
    later_ambient: LightImage | None = None

    @property
    def images(self) -> npt.NDArray[np.uint16]:
        return np.stack([image for image, _ in self.lights])


def _taken(rig: Rig, average: int) -> _Taken:
    """The pictures of one attempt."""
    info = rig.camera.info
    beat = FrameBeat(info.frame_period_s)
    by_software = rig.config.sequence_plan is None
    look = _looked(rig, average, beat) if by_software else _looked_in_sequence(rig, average)
    later = None if look.later_ambient is None else look.later_ambient[0]
    full_scale = (1 << info.bit_depth) - 1 if average == 1 else 65535
    noise = image_noise(_camera_record(info), info.bit_depth, full_scale, average)
    pictures = Pictures(look.images, look.ambient[0], later, full_scale, noise)
    names = [light_name(rig, light) for light in range(len(rig.lighting))]
    ambient_change = check_ambient(pictures)
    check_images(pictures.images, pictures.ambient, full_scale, names)

    def second_look() -> npt.NDArray[np.uint16]:
        if not by_software:
            return _looked_in_sequence(rig, average).images
        order = [light for group in like_signed(rig.lighting) for light in group][::-1]
        again = dict(zip(order, images_under(rig, order, average, beat), strict=True))
        return np.stack([again[light][0] for light in sorted(again)])

    checks = check_lights(pictures, rig.lighting, names, ambient_change, second_look)
    records = (*(record for _, record in look.lights), look.ambient[1])
    return _Taken(pictures, records, checks)


def _looked(rig: Rig, average: int, beat: FrameBeat) -> _Look:
    """One look, switched by software.

    Lights that count alike in the comparison of all are taken one after the other, with the second
    ambient image between the two groups: so light that is there for a while, in whatever
    consecutive pictures, either makes the lights disagree or the ambient images differ.
    """
    first, second = like_signed(rig.lighting)
    taken = images_under(rig, (None, *first, None, *second), average, beat)
    ambient, later_ambient = taken[0], taken.pop(len(first) + 1)
    lights = dict(zip((*first, *second), taken[1:], strict=True))
    return _Look(ambient, tuple(lights[light] for light in sorted(lights)), later_ambient)


def _looked_in_sequence(rig: Rig, average: int) -> _Look:
    """One look, switched by the controller at each frame, without a frame to spare."""
    ambient, *lights = images_in_sequence(rig, average)
    return _Look(ambient, tuple(lights))


def _put_out(rig: Rig) -> None:
    # The cause is what the caller must see; if this fails too, the watchdog is there.
    with suppress(HardwareError):
        rig.lights.off()


def _flush(rig: Rig) -> None:
    """Let the dark fill the camera's buffers, so that nothing of an attempt is in the next one."""
    info = rig.camera.info
    with suppress(HardwareError):
        for _ in range(info.queue_length + 1):
            rig.camera.read(info.queue_length * info.frame_period_s)


def _camera_record(info: CameraInfo) -> CameraRecord:
    return CameraRecord(
        kind=info.kind,
        name=info.name,
        exposure_ms=1000.0 * info.exposure_s,
        frame_rate_hz=1.0 / info.frame_period_s,
        gain_e_per_dn=info.gain_e_per_dn,
        read_noise_dn=info.read_noise_dn,
        black_level_dn=info.black_level_dn,
        controls=dict(info.controls),
    )
