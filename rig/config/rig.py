"""A whole ``rig.toml``, and the conditions between its sections."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, SerializeAsAny, model_validator

from classify.base.durable_file import durable_file
from classify.base.errors import ConfigError
from classify.base.models import Section, read_toml, validated
from rig.cameras.config import (
    CameraConfig,
    DeviceCameraConfig,
    SimulatedCameraConfig,
    StampedCameraConfig,
)
from rig.cameras.kinds import CAMERA_KINDS, camera_config

from .lights import SIMULATED, LightsConfig, SequencePlan, plan_sequence
from .simulation import SimulationConfig

# Settling time of a simulated LED to 1 %, in rise times from 10 to 90 %. An exponential takes
# ln 100 and ln 9 time constants for them.
_STEADY_PER_10_90 = math.log(100.0) / math.log(9.0)


class RigConfig(Section):
    """The configuration of a rig. ``RigConfig()`` is the simulated rig.

    Attributes
    ----------
    calibration
        Calibration file for captures; in `rig.toml` relative to that file.
    """

    name: str = Field(default="rig", min_length=1, max_length=200, description="of the rig")
    calibration: str | None = Field(default=None, min_length=1)
    lights: LightsConfig = LightsConfig()
    camera: Annotated[SerializeAsAny[CameraConfig], BeforeValidator(camera_config)] = (
        SimulatedCameraConfig()
    )
    simulation: SimulationConfig = SimulationConfig()

    @model_validator(mode="before")
    @classmethod
    def _default_camera_kind(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        lights, camera = values.get("lights", {}), values.get("camera", {})
        if not (isinstance(lights, dict) and isinstance(camera, dict)):
            return values
        kind = "simulated" if lights.get("port", SIMULATED) == SIMULATED else "v4l2"
        return {**values, "camera": {"kind": kind, **camera}}

    @model_validator(mode="after")
    def _sections_agree(self) -> Self:
        if conflict := next(self._conflicts(), None):
            raise ValueError(conflict)
        return self

    @property
    def set_bytes(self) -> int:
        """Size of a set's file: light images, ambient image and 20 kB of metadata."""
        images = len(self.lights.tilts_deg) + 1
        return 2 * images * self.camera.width_px * self.camera.height_px + 20_000

    def _conflicts(self) -> Iterator[str]:
        """Yield a message for each condition between the sections that does not hold."""
        lights, camera, simulation = self.lights, self.camera, self.simulation
        count, period_ms = len(lights.tilts_deg), 1000.0 / camera.frame_rate_hz
        if isinstance(camera, DeviceCameraConfig) and self.is_simulated:
            yield (
                f"camera.kind = {camera.kind!r} cannot see simulated LEDs; give lights.port a "
                "real controller's, or set camera.kind = 'simulated'"
            )
        if simulation.readout_ms > period_ms:
            yield (
                f"simulation.readout_ms = {simulation.readout_ms:g} does not fit into a frame at "
                f"{camera.frame_rate_hz:g} Hz; lower one of them"
            )
        for fault in () if simulation.faults is None else simulation.faults.leds:
            highest = fault.led if fault.other is None else max(fault.led, fault.other)
            if highest >= count:
                yield (
                    f"simulation.faults: there is no LED {highest}; give one of the {count} in "
                    "lights.tilts_deg, counted from 0"
                )
        if len(simulation.led_levels) not in (0, count):
            yield (
                f"simulation.led_levels has {len(simulation.led_levels)} levels for {count} LEDs; "
                "give one each"
            )
        pixels = camera.width_px * camera.height_px
        if simulation.hot_pixels > pixels // 2:
            yield (
                f"simulation.hot_pixels = {simulation.hot_pixels} is more than half of the "
                f"{pixels} pixels; set at most {pixels // 2}"
            )
        if simulation.placement.size_mm is not None and simulation.mm_per_px is None:
            yield "simulation.placement.size_mm needs simulation.mm_per_px, the size of a pixel"
        # Three frames: in transfer, exposed during the switch, and fresh.
        needed_ms = lights.settle_ms + 3.0 * period_ms + camera.exposure_ms
        if lights.watchdog_ms < needed_ms:
            yield (
                f"lights.watchdog_ms = {lights.watchdog_ms} would put the LEDs out before a frame "
                f"arrives; at this frame rate it must be at least {needed_ms:.0f}"
            )
        if (plan := self.sequence_plan) is None:
            return
        if lights.watchdog_ms < 1e3 * plan.duration_s:
            yield (
                f"lights.watchdog_ms = {lights.watchdog_ms} would end a sequence of "
                f"{1e3 * plan.duration_s:.0f} ms; raise it"
            )
        steady_ms = _STEADY_PER_10_90 * max(simulation.led_rise_ms, simulation.led_fall_ms)
        if self.is_simulated and lights.settle_ms < steady_ms:
            yield (
                f"lights.settle_ms = {lights.settle_ms:g}, but these simulated LEDs take "
                f"{steady_ms:.3g} ms until they are within 1 %; raise settle_ms"
            )

    @property
    def sequence_plan(self) -> SequencePlan | None:
        """The sequence that the controller runs for a set; None with ``software``.

        Raises
        ------
        ValueError
            If lights and camera leave no time to switch.
        """
        if self.lights.synchronisation == "software":
            return None
        if not isinstance(self.camera, StampedCameraConfig):
            raise ValueError(
                f"lights.synchronisation = {self.lights.synchronisation!r} identifies frames by "
                f"their numbers and times, which camera.kind = {self.camera.kind!r} does not give; "
                "set 'v4l2'"
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
        """Whether the lights, and therefore the images, are simulated."""
        return self.lights.port == SIMULATED

    def with_changes(self, **sections: dict[str, Any]) -> RigConfig:
        """Return a copy with some fields of some sections replaced, validated as a whole.

        A change of ``camera["kind"]`` keeps only the fields of the new kind.

        Raises
        ------
        ConfigError
            If the result is not a valid configuration.
        """
        values = self.model_dump()
        for section, changes in sections.items():
            values[section] = {**values[section], **changes}
        old, new = self.camera.kind, values["camera"]["kind"]
        if new != old and new in CAMERA_KINDS:
            fields = {*CAMERA_KINDS[new].config.model_fields, *sections["camera"]}
            values["camera"] = {key: values["camera"][key] for key in fields & {*values["camera"]}}
        return validated(values, RigConfig, "rig configuration")


def config_of(rig: str | Path) -> RigConfig:
    """Return the configuration of ``"sim"``, or of a ``rig.toml``; see `load_config`."""
    return RigConfig() if rig == "sim" else load_config(Path(rig))


def load_config(path: Path) -> RigConfig:
    """Read a ``rig.toml``.

    Raises
    ------
    ConfigError
        If it is missing or not TOML, or has an unknown key or a value out of range; the message
        names file, key and value.
    """
    values = read_toml(
        path, "no such rig configuration; write one with ps4rig rig init, or use --rig sim"
    )
    simulation = values.get("simulation", {})
    camera = values.get("camera")
    if isinstance(camera, dict) and isinstance(camera.get("set_file"), str):
        camera["set_file"] = str(path.parent / camera["set_file"])
    if isinstance(simulation, dict) and isinstance(simulation.get("faults"), str):
        simulation["faults"] = read_toml(path.parent / simulation["faults"], "no such fault plan")
    if isinstance(values.get("calibration"), str) and values["calibration"]:
        values["calibration"] = str(path.parent / values["calibration"])
    lights = values.get("lights", {})
    if isinstance(lights, dict) and "port" not in lights:
        # The default is the simulated controller, which a file must request explicitly.
        raise ConfigError(
            f"{path}: lights.port is missing; give the light controller's port, or "
            f"{SIMULATED!r} for a simulated rig"
        )
    return validated(values, RigConfig, str(path))


def store_values(path: Path, sections: Mapping[str, Mapping[str, str | float]]) -> None:
    """Change values in a ``rig.toml``, atomically; its comments and layout stay."""
    import tomlkit

    text = path.read_bytes().decode()
    document: Any = tomlkit.parse(text)
    for section, values in sections.items():
        table = document.setdefault(section, tomlkit.table())
        # Blank lines and comments, whose key is None, at the end of a table introduce the next one.
        entries = table.value.body if isinstance(table, tomlkit.items.Table) else []
        introduction = []
        while entries and entries[-1][0] is None:
            introduction.append(entries.pop())
        table.update(values)
        entries.extend(reversed(introduction))
    line_end = "\r\n" if "\r\n" in text else "\n"
    changed = tomlkit.dumps(document).replace("\r\n", "\n").replace("\n", line_end)
    # Resolved, so that a symbolic link stays and its target changes.
    with durable_file(path.resolve()) as temporary:
        temporary.chmod(path.stat().st_mode)
        temporary.write_bytes(changed.encode())
        try:
            load_config(temporary)
        except ConfigError as error:
            raise ConfigError(str(error).replace(str(temporary), str(path))) from error
