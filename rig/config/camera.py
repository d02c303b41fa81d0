"""The section ``[camera]`` of ``rig.toml``: which camera, how it is set, what its time means."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from .section import Section

__all__ = ["PIXEL_FORMAT_BITS", "CameraConfig"]

# Pixel formats by name with their true depth. They are decoded in `pixel_formats`, which is not
# imported here: a configuration must be readable without loading OpenCV.
PIXEL_FORMAT_BITS = {
    "GREY": 8,
    "Y10": 10,
    "Y12": 12,
    "Y16": 16,
    "YUYV": 8,
    "UYVY": 8,
    "RGB24": 8,
    "BGR24": 8,
    "MJPG": 8,
    **{
        f"{order}{bits}": bits
        for order in ("SRGGB", "SGRBG", "SGBRG", "SBGGR")
        for bits in (8, 10, 12)
    },
}


class CameraConfig(Section):
    """The camera and how it is set.

    `bits` of a V4L2 camera are those of its `pixel_format`; the keys below `exposure_ms` are for
    cameras that are devices, but for what says when a frame was exposed.

    Attributes
    ----------
    kind
        ``v4l2``, ``opencv`` (`OpencvCamera` says what it cannot do), ``simulated``, or ``replay``
        of a captured set. Left out it is v4l2 above a real light controller and simulated above
        a simulated one.
    device
        A path, a name in ``/dev/v4l/by-id``, or the number of ``/dev/video...``. The names stay
        the same when cameras are plugged in another order.
    set_file
        The captured set of a replay, whose size and depth the frames have.
    pixel_format
        A key of `PIXEL_FORMAT_BITS`.
    allow_compressed
        Whether MJPG may be used, whose losses are in every slope.
    fixed_exposure
        The camera has no exposure control, and `exposure_ms` is what it does by itself.
    gain, gamma
        In the camera's own units; None leaves them as they are.
    timestamp_marks
        What the driver's time stamp of a frame is: its end, which is never later than the truth,
        or ``driver``, for what the driver claims, or ``writer``, for a loopback device: its end
        by the word of the program that writes it, which counts the frames too. Left out, a
        simulated driver is believed and no other.
    timestamp_offset_ms
        Added to the driver's time stamp.
    timestamp_uncertainty_ms
        How far that may be too late: a frame counts as exposed earlier by as much.
    readout_ms
        From the first row's exposure to the last row's. None is a whole frame period, the most
        that a rolling shutter can take.
    timing_measured_at
        The camera's `mode` for which ``ps4rig rig latency`` found the four before; in another
        they mean nothing, and the camera is not opened.
    """

    kind: Literal["v4l2", "opencv", "simulated", "replay"] = "simulated"
    width_px: int = Field(default=512, ge=16, le=8192)
    height_px: int = Field(default=512, ge=16, le=8192)
    bits: Literal[8, 10, 12, 16] = 12
    frame_rate_hz: float = Field(default=30.0, ge=0.1, le=1000.0)
    exposure_ms: float = Field(default=20.0, gt=0.0, le=10_000.0)
    device: str | None = Field(default=None, min_length=1, max_length=4096)
    set_file: str | None = Field(default=None, min_length=1, max_length=4096)
    pixel_format: str = "GREY"
    allow_compressed: bool = False
    fixed_exposure: bool = False
    gain: int | None = Field(default=None, ge=0, le=2**31 - 1)
    gamma: int | None = Field(default=None, ge=0, le=2**31 - 1)
    timestamp_marks: Literal["frame_end", "driver", "writer"] | None = None
    timestamp_offset_ms: float = Field(default=0.0, ge=-1000.0, le=1000.0)
    timestamp_uncertainty_ms: float = Field(default=0.0, ge=0.0, le=1000.0)
    readout_ms: float | None = Field(default=None, ge=0.0, le=10_000.0)
    timing_measured_at: str | None = Field(default=None, min_length=1, max_length=200)

    @property
    def believes_driver(self) -> bool:
        """Whether a driver that claims to stamp the start of exposure is taken at its word."""
        if self.timestamp_marks is None:
            return self.kind in ("simulated", "replay")
        return self.timestamp_marks == "driver"

    @property
    def mode(self) -> str:
        """What frame timing depends on, in words."""
        pixels = self.pixel_format if self.kind == "v4l2" else f"{self.kind} {self.bits} bit"
        return (
            f"{pixels} {self.width_px}x{self.height_px}, {self.frame_rate_hz:g} Hz, "
            f"{self.exposure_ms:g} ms"
        )

    @model_validator(mode="before")
    @classmethod
    def _what_the_kind_implies(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        kind = values.get("kind", "simulated")
        implied: dict[str, Any] = {}
        if kind == "v4l2":
            name = values.get("pixel_format", "GREY")
            if isinstance(name, str) and name in PIXEL_FORMAT_BITS:
                implied["bits"] = PIXEL_FORMAT_BITS[name]
        elif kind == "opencv":
            implied["bits"] = 8
        return implied | values

    @field_validator("device", mode="before")
    @classmethod
    def _device_may_be_a_number(cls, device: Any) -> Any:
        return str(device) if type(device) is int else device

    @field_validator("pixel_format")
    @classmethod
    def _pixel_format_is_known(cls, name: str) -> str:
        if name not in PIXEL_FORMAT_BITS:
            raise ValueError(f"{name!r} is unknown; it is one of " + ", ".join(PIXEL_FORMAT_BITS))
        return name

    @model_validator(mode="after")
    def _exposure_fits(self) -> Self:
        period_ms = 1000.0 / self.frame_rate_hz
        for key, time_ms in (("exposure_ms", self.exposure_ms), ("readout_ms", self.readout_ms)):
            if time_ms is not None and time_ms > period_ms:
                raise ValueError(
                    f"{key} = {time_ms:g} does not fit into a frame at {self.frame_rate_hz:g} Hz; "
                    "lower one of them"
                )
        return self

    @model_validator(mode="after")
    def _is_one_camera(self) -> Self:
        for key, value, kinds in (
            ("device", self.device, ("v4l2", "opencv")),
            ("set_file", self.set_file, ("replay",)),
        ):
            if value is not None and self.kind not in kinds:
                raise ValueError(
                    f"{key} = {value!r} is given, but kind is {self.kind!r}; "
                    f"set kind = {kinds[0]!r}"
                )
            if value is None and self.kind in kinds:
                best = "the camera's, best its name in /dev/v4l/by-id"
                raise ValueError(
                    f"{key} is missing; give {best if key == 'device' else 'the set to replay'}"
                )
        return self

    @model_validator(mode="after")
    def _opencv_can_do_it(self) -> Self:
        if self.kind != "opencv":
            return self
        if self.bits != 8:
            raise ValueError(f"bits = {self.bits}, but OpenCV gives 8; leave bits out")
        for key in (
            "timestamp_marks",
            "timestamp_offset_ms",
            "timestamp_uncertainty_ms",
            "timing_measured_at",
        ):
            if getattr(self, key):
                raise ValueError(
                    f"{key} = {getattr(self, key)!r}, but OpenCV gives no time stamps; take it "
                    "away, or set kind = 'v4l2'"
                )
        return self

    @model_validator(mode="after")
    def _pixel_format_can_be_measured(self) -> Self:
        if self.kind != "v4l2":
            return self
        depth = PIXEL_FORMAT_BITS[self.pixel_format]
        if self.bits != depth:
            raise ValueError(
                f"bits = {self.bits}, but pixel_format = {self.pixel_format!r} has {depth}; "
                "leave bits out"
            )
        if self.pixel_format == "MJPG" and not self.allow_compressed:
            raise ValueError(
                "pixel_format = 'MJPG' is lossy; choose another, or set allow_compressed = true"
            )
        return self
