"""`capture_set`: switch, wait, take only frames that began after the light was there."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from rig import CameraInfo, Frame, FrameFlag, HardwareError, Rig, Switch

from .captured_set import CapturedSet
from .errors import SetRejected
from .frame_mean import FrameMean, check_frame
from .hardware_set import images_in_sequence
from .quality import check_images
from .set_file import pixels_sha256
from .set_metadata import (
    CameraRecord,
    ControllerRecord,
    ImageRecord,
    LightingRecord,
    SetMetadata,
    checked_label,
)

__all__ = ["MAX_AVERAGE", "capture_set"]

MAX_AVERAGE = 1024
# Beyond what the frame rate and the driver's queue explain.
_SPARE_S = 0.5


def capture_set(rig: Rig, label: str | None = None, *, average: int = 1) -> CapturedSet:
    """One set: the ambient image, then one image under each LED in order.

    A frame counts only if its exposure began after the controller's acknowledge plus the settle
    time; what the camera's driver still had in its queue is thrown away. After each image the
    controller is asked whether that LED was still the one lit. The LEDs are put out at the end,
    and when anything is raised.

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
        If an image is saturated or dark, or no fresh frame came; with every cause named.
    HardwareError
        If the controller or the camera fails.
    """
    if not 1 <= average <= MAX_AVERAGE:
        raise InputError(f"average is {average}; it must be 1 to {MAX_AVERAGE} frames")
    checked_label(label)
    rig.lights.recover()
    created = datetime.now(UTC)
    try:
        if rig.config.sequence_plan is None:
            order = (None, *range(len(rig.lighting)))
            (ambient, ambient_record), *taken = (_image_under(rig, n, average) for n in order)
        else:
            (ambient, ambient_record), *taken = images_in_sequence(rig, average)
        rig.lights.off()
    except BaseException:
        # The cause is what the caller must see; if this fails too, the watchdog is there.
        with suppress(HardwareError):
            rig.lights.off()
        raise
    images = np.stack([image for image, _ in taken])
    info = rig.camera.info
    full_scale = (1 << info.bit_depth) - 1 if average == 1 else 65535
    names = [_light_name(rig, light) for light in range(len(rig.lighting))]
    check_images(images, ambient, full_scale, names)
    placement = None if rig.simulation is None else rig.simulation.placement
    metadata = SetMetadata(
        label=label,
        created_utc=created.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        simulated=rig.simulation is not None,
        bit_depth=info.bit_depth,
        full_scale=full_scale,
        lighting=LightingRecord.of(rig.lighting),
        images=(*(record for _, record in taken), ambient_record),
        orientation_deg=None if placement is None else placement.rotate_deg,
        placement=placement,
        rig_name=rig.config.name,
        settle_ms=rig.config.lights.settle_ms,
        synchronisation=rig.config.lights.synchronisation,
        camera=_camera_record(info),
        controller=ControllerRecord(**asdict(rig.lights.identity)),
        software_version=version("ps4rig"),
        pixels_sha256=pixels_sha256(images, ambient),
    )
    return CapturedSet(images, ambient, metadata)


def _image_under(
    rig: Rig, light: int | None, average: int
) -> tuple[npt.NDArray[np.uint16], ImageRecord]:
    """Switch to `light` (None: all off) and take the mean of `average` fresh frames."""
    switch = rig.lights.off() if light is None else rig.lights.select(light)
    fresh = _FreshFrames(rig, light, switch)
    mean = FrameMean(rig.camera.info, average)
    for _ in range(average):
        mean.add(fresh.take())
        # Asked after the exposure: a watchdog that tripped or a restart in it shows here.
        state = rig.lights.confirm(light)
    record = ImageRecord(
        light=light,
        frames=mean.records,
        led_acknowledged_s=switch.acknowledged_s,
        led_level_percent=None if light is None else state.levels_percent[light],
        controller_time_us=switch.controller_time_us,
        stale_frames=fresh.stale,
        corrupt_frames=fresh.corrupt,
        lost_frames=fresh.lost,
    )
    return mean.image(), record


class _FreshFrames:
    """Frames whose exposure began under the light of one switch, and a count of all others."""

    def __init__(self, rig: Rig, light: int | None, switch: Switch) -> None:
        self._rig = rig
        self._light = light
        self._not_before_s = switch.acknowledged_s + rig.config.lights.settle_ms / 1000.0
        self._previous: int | None = None
        # Gaps before the first frame under this light have nothing to do with this image.
        self._under_light = False
        self.stale = 0
        self.corrupt = 0
        self.lost = 0

    def take(self) -> Frame:
        """The next good frame.

        Raises
        ------
        SetRejected
            If none comes in the time that the queue and the frame rate account for.
        CameraError
            If the camera gives no frame at all in that time.
        """
        info = self._rig.camera.info
        clock = self._rig.clock
        frames_s = (info.queue_length + 2) * info.frame_period_s + info.exposure_s
        settle_s = self._rig.config.lights.settle_ms / 1000.0
        patience_s = frames_s + settle_s + _SPARE_S
        deadline_s = clock.now_s() + patience_s
        while clock.now_s() < deadline_s:
            # Not only what remains: a camera that gives bad frames has not failed to give any.
            frame = self._rig.camera.read(patience_s)
            check_frame(frame, info, clock.now_s())
            if self._previous is not None:
                if frame.sequence <= self._previous:
                    raise SetRejected(
                        f"set rejected: frame {frame.sequence} came twice under {self._name()}"
                    )
                if self._under_light:
                    self.lost += frame.sequence - self._previous - 1
            self._previous = frame.sequence
            self._under_light = frame.exposure_start_s >= self._not_before_s
            if not self._under_light:
                self.stale += 1
            elif frame.flags != FrameFlag.GOOD:
                self.corrupt += 1
            else:
                return frame
        raise SetRejected(
            f"set rejected: no good frame under {self._name()} in "
            f"{patience_s:.1f} s ({self.stale} from before the switch, "
            f"{self.corrupt} corrupt, {self.lost} lost)"
        )

    def _name(self) -> str:
        return "ambient light" if self._light is None else _light_name(self._rig, self._light)


def _light_name(rig: Rig, light: int) -> str:
    return f"LED {light} (tilt {rig.lighting.tilts_deg[light]:g})"


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
