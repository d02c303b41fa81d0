"""``rig.toml``: what the rig consists of."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    ValidationError,
    field_validator,
    model_validator,
)

from classify import Lighting
from classify.lighting import RING_TILTS_DEG
from firmware_sim.firmware import (
    WATCHDOG_DEFAULT_MS,
    WATCHDOG_MAX_MS,
    WATCHDOG_MIN_MS,
)

from .errors import ConfigError
from .fault_plan import FaultPlan

__all__ = [
    "PIXEL_FORMAT_BITS",
    "CameraConfig",
    "LightsConfig",
    "Placement",
    "RigConfig",
    "SimulationConfig",
    "load_config",
]

# As `lights.port`: the firmware runs here, on a pty.
SIMULATED = "simulated"
_MAX_TOML_BYTES = 1 << 20
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
Degrees = Annotated[FiniteFloat, Field(ge=-3600.0, le=3600.0)]
Shift = Annotated[FiniteFloat, Field(ge=-1e6, le=1e6)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class LightsConfig(_Section):
    """The LED controller and where its LEDs stand.

    `port` is a device (``/dev/ttyACM0``), a pyserial URL, or ``simulated``.
    """

    port: str = Field(default=SIMULATED, min_length=1)
    baud: int = Field(default=115_200, ge=300, le=12_000_000)
    tilts_deg: tuple[Degrees, ...] = Field(default=RING_TILTS_DEG, min_length=3, max_length=64)
    slant_deg: float = Field(default=45.0, gt=0.0, le=85.0)
    settle_ms: float = Field(default=5.0, ge=0.0, le=10_000.0)
    watchdog_ms: int = Field(default=WATCHDOG_DEFAULT_MS, ge=WATCHDOG_MIN_MS, le=WATCHDOG_MAX_MS)

    @property
    def lighting(self) -> Lighting:
        """The light directions."""
        return Lighting.from_angles(self.tilts_deg, self.slant_deg)


class CameraConfig(_Section):
    """The camera and how it is set.

    `bits` of a V4L2 camera are those of its `pixel_format`; the keys below `exposure_ms` are for
    such a camera only.

    Attributes
    ----------
    device
        A path, a name in ``/dev/v4l/by-id``, or the number of ``/dev/video...``. The names stay
        the same when cameras are plugged in another order.
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
        or ``driver``, for what the driver claims.
    timestamp_offset_ms
        Added to the driver's time stamp.
    readout_ms
        From the end of the first row's exposure to the end of the frame. None is a whole frame
        period, the most that a rolling shutter can take.
    """

    kind: Literal["simulated", "v4l2"] = "simulated"
    width_px: int = Field(default=512, ge=16, le=8192)
    height_px: int = Field(default=512, ge=16, le=8192)
    bits: Literal[8, 10, 12, 16] = 12
    frame_rate_hz: float = Field(default=30.0, ge=0.1, le=1000.0)
    exposure_ms: float = Field(default=20.0, gt=0.0, le=10_000.0)
    device: str | None = Field(default=None, min_length=1, max_length=4096)
    pixel_format: str = "GREY"
    allow_compressed: bool = False
    fixed_exposure: bool = False
    gain: int | None = Field(default=None, ge=0, le=2**31 - 1)
    gamma: int | None = Field(default=None, ge=0, le=2**31 - 1)
    timestamp_marks: Literal["frame_end", "driver"] = "frame_end"
    timestamp_offset_ms: float = Field(default=0.0, ge=-1000.0, le=1000.0)
    readout_ms: float | None = Field(default=None, ge=0.0, le=10_000.0)

    @model_validator(mode="before")
    @classmethod
    def _bits_of_the_pixel_format(cls, values: Any) -> Any:
        if isinstance(values, dict) and values.get("kind") == "v4l2" and "bits" not in values:
            name = values.get("pixel_format", "GREY")
            if isinstance(name, str) and name in PIXEL_FORMAT_BITS:
                return {**values, "bits": PIXEL_FORMAT_BITS[name]}
        return values

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
        if self.exposure_ms > 1000.0 / self.frame_rate_hz:
            raise ValueError(
                f"exposure_ms = {self.exposure_ms:g} does not fit into a frame at "
                f"{self.frame_rate_hz:g} Hz; lower one of them"
            )
        return self

    @model_validator(mode="after")
    def _is_one_camera(self) -> Self:
        if self.kind == "simulated":
            if self.device is not None:
                raise ValueError(
                    f"device = {self.device!r} is given, but kind is 'simulated'; set kind = 'v4l2'"
                )
            return self
        if self.device is None:
            raise ValueError(
                "device is missing; give the camera's, best its name in /dev/v4l/by-id"
            )
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


class Placement(_Section):
    """Which part lies under the simulated camera, and how.

    `surface` is rock, sand, malv, ogil, a bundled material or a material folder. The patch's
    centre is moved by `shift_px` (x right, y up) over the periodic surface, then the surface is
    turned anticlockwise by `rotate_deg` about that centre. `seed` chooses the noise, and for the
    four synthetic surfaces their realisation.
    """

    surface: str = "rock"
    rotate_deg: Degrees = 0.0
    shift_px: tuple[Shift, Shift] = (0.0, 0.0)
    seed: int = Field(default=1, ge=0, lt=2**63)


class SimulationConfig(_Section):
    """What only a simulated rig has.

    `clock` is ``virtual`` (a set takes milliseconds) or ``real`` (it takes what frames take).
    `ambient` is the light that no LED makes, as a fraction of one LED at full level. `faults` are
    what goes wrong, on purpose; a ``rig.toml`` has them or names their file.
    """

    clock: Literal["virtual", "real"] = "virtual"
    ambient: float = Field(default=0.02, ge=0.0, le=1.0)
    led_rise_ms: float = Field(default=0.5, gt=0.0, le=100.0)
    led_fall_ms: float = Field(default=0.3, gt=0.0, le=100.0)
    placement: Placement = Placement()
    faults: FaultPlan | None = None


class RigConfig(_Section):
    """A whole rig. ``RigConfig()`` is the simulated one."""

    name: str = Field(default="rig", min_length=1, max_length=200)
    lights: LightsConfig = LightsConfig()
    camera: CameraConfig = CameraConfig()
    simulation: SimulationConfig = SimulationConfig()

    @model_validator(mode="after")
    def _camera_sees_the_lights(self) -> Self:
        if self.camera.kind == "v4l2" and self.is_simulated:
            raise ValueError(
                "camera.kind = 'v4l2' cannot see simulated LEDs; give lights.port a real "
                "controller's, or set camera.kind = 'simulated'"
            )
        return self

    @model_validator(mode="after")
    def _faults_are_of_its_leds(self) -> Self:
        faults = () if self.simulation.faults is None else self.simulation.faults.leds
        for fault in faults:
            for led in (fault.led, fault.other):
                if led is not None and led >= len(self.lights.tilts_deg):
                    raise ValueError(
                        f"simulation.faults: there is no LED {led}; lights.tilts_deg names "
                        f"{len(self.lights.tilts_deg)}"
                    )
        return self

    @model_validator(mode="after")
    def _watchdog_waits_for_frames(self) -> Self:
        period_ms = 1000.0 / self.camera.frame_rate_hz
        needed_ms = self.lights.settle_ms + 3.0 * period_ms + self.camera.exposure_ms
        if self.lights.watchdog_ms < needed_ms:
            raise ValueError(
                f"lights.watchdog_ms = {self.lights.watchdog_ms} would put the LEDs out while a "
                f"frame is awaited; at this frame rate it must be at least {needed_ms:.0f}"
            )
        return self

    @property
    def is_simulated(self) -> bool:
        """Whether its lights, and so all it shows, are simulated."""
        return self.lights.port == SIMULATED

    def with_changes(self, **sections: dict[str, Any]) -> RigConfig:
        """A copy with some fields of some sections replaced, validated as a whole.

        Raises
        ------
        ConfigError
            If the result is not a valid configuration.
        """
        values = self.model_dump()
        for section, changes in sections.items():
            values[section] = {**values[section], **changes}
        return _validated(values, "rig configuration")


def load_config(path: Path) -> RigConfig:
    """Read a ``rig.toml``.

    Raises
    ------
    ConfigError
        If it is missing, not TOML, has an unknown key or a value out of range.
    """
    values = _read_toml(path, "no such rig configuration (or use --rig sim)")
    simulation = values.get("simulation", {})
    if isinstance(simulation, dict) and isinstance(simulation.get("faults"), str):
        simulation["faults"] = _read_toml(path.parent / simulation["faults"], "no such fault plan")
    lights = values.get("lights", {})
    if isinstance(lights, dict) and "port" not in lights:
        # Left out it would be the simulated one, and nobody would have asked for that.
        raise ConfigError(
            f"{path}: lights.port is missing; give the light controller's port, or "
            f"{SIMULATED!r} for a simulated rig"
        )
    return _validated(values, str(path))


def _read_toml(path: Path, if_missing: str) -> dict[str, Any]:
    try:
        if path.stat().st_size > _MAX_TOML_BYTES:
            raise ConfigError(f"{path}: larger than {_MAX_TOML_BYTES} bytes; no configuration")
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ConfigError(f"{path}: {if_missing}") from error
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    # Besides its own error tomllib lets through those of deep nesting and of endless numbers.
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error


def _validated(values: dict[str, Any], source: str) -> RigConfig:
    try:
        return RigConfig.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        field = "".join(f"{part}." for part in first["loc"]).rstrip(".")
        cause = first["msg"].removeprefix("Value error, ")
        raise ConfigError(": ".join(filter(None, (source, field, cause)))) from error
