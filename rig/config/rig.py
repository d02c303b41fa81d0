"""``rig.toml``: what the rig consists of."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, FiniteFloat, ValidationError, field_validator, model_validator

from classify import Lighting
from classify.lighting import RING_TILTS_DEG
from firmware_sim.firmware import (
    WATCHDOG_DEFAULT_MS,
    WATCHDOG_MAX_MS,
    WATCHDOG_MIN_MS,
)
from rig.errors import ConfigError
from rig.lights import SequencePlan, plan_sequence

from .camera import PIXEL_FORMAT_BITS, CameraConfig
from .fault_plan import FaultPlan
from .section import Section

__all__ = [
    "PIXEL_FORMAT_BITS",
    "CameraConfig",
    "LightsConfig",
    "Placement",
    "RigConfig",
    "SimulationConfig",
    "load_config",
]

# An LED is steady when 1 % is missing: so many times its 10 to 90 % time after the switch.
_STEADY_PER_10_90 = math.log(100.0) / math.log(9.0)
# As `lights.port`: the firmware runs here, on a pty.
SIMULATED = "simulated"
# As `lights.port`: wherever the controller is plugged in.
AUTO = "auto"
_MAX_TOML_BYTES = 1 << 20
Degrees = Annotated[FiniteFloat, Field(ge=-3600.0, le=3600.0)]
Intensity = Annotated[FiniteFloat, Field(ge=0.01, le=100.0)]
TurnTime = Annotated[FiniteFloat, Field(ge=1.0, le=1e6)]
Shift = Annotated[FiniteFloat, Field(ge=-1e6, le=1e6)]


class LightsConfig(Section):
    """The LED controller and where its LEDs stand.

    `port` is a device (``/dev/ttyACM0``), a pyserial URL, ``auto`` or ``simulated``. With ``auto``
    the controller is found by its `serial_number` and by `usb_id`, vendor and product, as far as
    they are given. `intensities` are how strong the LEDs are by make, relative to each other; all
    the same if left out. `synchronisation` is who moves on from light to light: the ``software``;
    the controller at each edge of the camera's ``strobe``; or the controller by time, which then
    has to ``trigger`` the camera.
    """

    port: str = Field(default=SIMULATED, min_length=1)
    serial_number: str | None = Field(default=None, min_length=1, max_length=200)
    usb_id: str | None = Field(default=None, pattern=r"^[0-9a-f]{4}:[0-9a-f]{4}$")
    baud: int = Field(default=115_200, ge=300, le=12_000_000)
    tilts_deg: tuple[Degrees, ...] = Field(default=RING_TILTS_DEG, min_length=3, max_length=64)
    slant_deg: float = Field(default=45.0, gt=0.0, le=85.0)
    intensities: tuple[Intensity, ...] = ()
    settle_ms: float = Field(default=5.0, ge=0.0, le=10_000.0)
    watchdog_ms: int = Field(default=WATCHDOG_DEFAULT_MS, ge=WATCHDOG_MIN_MS, le=WATCHDOG_MAX_MS)
    synchronisation: Literal["software", "strobe", "trigger"] = "software"

    @field_validator("usb_id", mode="before")
    @classmethod
    def _usb_id_in_small_letters(cls, usb_id: Any) -> Any:
        return usb_id.lower() if isinstance(usb_id, str) else usb_id

    @model_validator(mode="after")
    def _is_looked_for_one_way(self) -> Self:
        if self.port != AUTO and (self.serial_number is not None or self.usb_id is not None):
            raise ValueError(
                f"serial_number and usb_id are for port = {AUTO!r}, but port is {self.port!r}; "
                "leave them out, or set that"
            )
        return self

    @property
    def lighting(self) -> Lighting:
        """Where the lights stand, and how strong they are."""
        ring = Lighting.from_angles(self.tilts_deg, self.slant_deg)
        return Lighting(ring.directions, np.array(self.intensities))

    @model_validator(mode="after")
    def _one_intensity_each(self) -> Self:
        if len(self.intensities) not in (0, len(self.tilts_deg)):
            raise ValueError(
                f"{len(self.intensities)} intensities for {len(self.tilts_deg)} LEDs; give one each"
            )
        return self


class Placement(Section):
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


class SimulationConfig(Section):
    """What only a simulated rig has.

    `clock` is ``virtual`` (a set takes milliseconds) or ``real`` (it takes what frames take).
    `ambient` is the light that no LED makes, as a fraction of one LED at full level. `readout_ms`
    is from the first row's exposure to the last row's, 0 for a global shutter. `faults` are what
    goes wrong, on purpose; a ``rig.toml`` has them or names their file. `controller_turn_us` is the
    least and the most time of one turn of the controller's main loop: so late may it be to switch
    after the end of an exposure.

    The camera's driver stamps the start of exposure and is right. With a `stamp_lag_ms` it stamps
    each frame so much later than that, as drivers do that stamp the arrival of data, and up to
    `stamp_jitter_ms` more; what its stamp means is then for ``ps4rig rig latency`` to find out.
    """

    clock: Literal["virtual", "real"] = "virtual"
    ambient: float = Field(default=0.02, ge=0.0, le=1.0)
    led_rise_ms: float = Field(default=0.5, gt=0.0, le=100.0)
    led_fall_ms: float = Field(default=0.3, gt=0.0, le=100.0)
    controller_turn_us: tuple[TurnTime, TurnTime] = (50.0, 200.0)
    readout_ms: float = Field(default=0.0, ge=0.0, le=10_000.0)
    stamp_lag_ms: float | None = Field(default=None, ge=-1000.0, le=1000.0)
    stamp_jitter_ms: float = Field(default=0.0, ge=0.0, le=100.0)
    placement: Placement = Placement()
    faults: FaultPlan | None = None


class RigConfig(Section):
    """A whole rig. ``RigConfig()`` is the simulated one."""

    name: str = Field(default="rig", min_length=1, max_length=200)
    lights: LightsConfig = LightsConfig()
    camera: CameraConfig = CameraConfig()
    simulation: SimulationConfig = SimulationConfig()

    @model_validator(mode="before")
    @classmethod
    def _camera_is_as_real_as_the_lights(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        lights, camera = values.get("lights", {}), values.get("camera", {})
        if not (isinstance(lights, dict) and isinstance(camera, dict)) or "kind" in camera:
            return values
        kind = "simulated" if lights.get("port", SIMULATED) == SIMULATED else "v4l2"
        return {**values, "camera": {"kind": kind, **camera}}

    @model_validator(mode="after")
    def _camera_sees_the_lights(self) -> Self:
        if self.camera.kind in ("v4l2", "opencv") and self.is_simulated:
            raise ValueError(
                f"camera.kind = {self.camera.kind!r} cannot see simulated LEDs; give lights.port a "
                "real controller's, or set camera.kind = 'simulated'"
            )
        return self

    @model_validator(mode="after")
    def _simulated_readout_fits(self) -> Self:
        if self.simulation.readout_ms > 1000.0 / self.camera.frame_rate_hz:
            raise ValueError(
                f"simulation.readout_ms = {self.simulation.readout_ms:g} does not fit into a frame "
                f"at {self.camera.frame_rate_hz:g} Hz"
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

    @model_validator(mode="after")
    def _sequence_is_possible(self) -> Self:
        plan = self.sequence_plan
        if plan is not None and self.lights.watchdog_ms < 1e3 * plan.duration_s:
            raise ValueError(
                f"lights.watchdog_ms = {self.lights.watchdog_ms} would end a sequence of "
                f"{1e3 * plan.duration_s:.0f} ms"
            )
        simulation = self.simulation
        steady_ms = _STEADY_PER_10_90 * max(simulation.led_rise_ms, simulation.led_fall_ms)
        if plan is not None and self.is_simulated and self.lights.settle_ms < steady_ms:
            raise ValueError(
                f"lights.settle_ms = {self.lights.settle_ms:g}, but these simulated LEDs take "
                f"{steady_ms:.3g} ms until they are within 1 %"
            )
        return self

    @property
    def sequence_plan(self) -> SequencePlan | None:
        """What the controller is asked to do for a set; None with ``software``.

        Raises
        ------
        ValueError
            If lights and camera leave no time to switch.
        """
        if self.lights.synchronisation == "software":
            return None
        if self.camera.kind == "opencv":
            raise ValueError(
                f"lights.synchronisation = {self.lights.synchronisation!r} tells frames by their "
                "numbers and times, which OpenCV does not give; set camera.kind = 'v4l2'"
            )
        readout_ms = self.simulation.readout_ms if self.is_simulated else self.camera.readout_ms
        if readout_ms is None:
            raise ValueError(
                f"lights.synchronisation = {self.lights.synchronisation!r} needs to know when the "
                "last row is exposed; give camera.readout_ms, which is 0 for a global shutter"
            )
        return plan_sequence(
            len(self.lights.tilts_deg),
            triggers=self.lights.synchronisation == "trigger",
            settle_s=self.lights.settle_ms / 1e3,
            period_s=1.0 / self.camera.frame_rate_hz,
            exposed_s=(self.camera.exposure_ms + readout_ms) / 1e3,
        )

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
    camera = values.get("camera")
    if isinstance(camera, dict) and isinstance(camera.get("set_file"), str):
        camera["set_file"] = str(path.parent / camera["set_file"])
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
