"""The simulated rig below the drivers: firmware on a pty, LEDs, a part, a camera above it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from classify.errors import InputError
from firmware_sim import (
    Clock,
    RealClock,
    Server,
    SimulatedBoard,
    SimulatedController,
    VirtualClock,
    serve_pty,
)
from firmware_sim.faults import FaultyLine, faulty_leds
from firmware_sim.led import Led
from firmware_sim.server import Device
from rig.camera import Camera
from rig.config.camera import ReplayCameraConfig, SimulatedCameraConfig
from rig.config.fault_plan import FaultPlan
from rig.config.rig import RigConfig
from rig.config.simulation import Placement
from rig.errors import ConfigError
from rig.frame_time import exposure_start_s, require_measured_mode, start_known_to_s
from rig.lights.heartbeat import TendedClock
from rig.scene.material_folder import bundled_materials, load_material
from rig.scene.render import SceneImages, render_frame
from rig.scene.surfaces import PeriodicSurface
from rig.scene.synthetic import SYNTHETIC_NAMES, SYNTHETIC_TEXTURES, synthetic_surface, tile_side_px

from .camera import CameraIdentity, LitScene, SimulatedCamera
from .frame_faults import FaultyCamera
from .sensor import Sensor, SensorModel

__all__ = ["Simulation", "surface_names"]

# Keeps the noise of time stamps apart from that of pixels.
_JITTER_STREAM = 1


def surface_names() -> tuple[str, ...]:
    """The surfaces to begin with: the four of the thesis, then the bundled materials.

    None needs a folder, and neither do the other names of `SYNTHETIC_TEXTURES`.
    """
    return (*SYNTHETIC_NAMES, *bundled_materials())


@dataclass(frozen=True)
class _Seen:
    """What the camera looks at, and what it makes of it."""

    scene: LitScene
    sensor: Sensor
    identity: CameraIdentity

    @classmethod
    def replayed(cls, config: RigConfig, camera: ReplayCameraConfig) -> Self:
        # Here, so that other rigs open without loading tifffile.
        from .recorded_set import read_recorded_set

        recorded = read_recorded_set(Path(camera.set_file))
        recorded.require_lighting(config.lights.lighting)
        name = f"replay of {recorded.origin['set_file']}"
        identity = CameraIdentity("replay", name, {"replay": recorded.origin})
        return cls(recorded, recorded.pixels(camera.exposure_ms), identity)


class Simulation:
    """Everything of a simulated rig that is hardware in a real one.

    `port` is where the light controller's firmware answers, `camera` looks at the part that
    `place` put there or shows a captured set again (`placement` is None then), `board` knows what
    the LEDs really do. `frames` is what a program reads of the camera: its frames, with the faults
    that were asked for.

    Parameters
    ----------
    config
        A rig whose lights and camera are taken for simulated, whatever it says.
    serve
        Gives the controller its address.
    """

    def __init__(self, config: RigConfig, serve: Callable[[Device], Server] = serve_pty) -> None:
        self._config = config
        self._serve = serve
        self._surface: tuple[tuple[object, ...], PeriodicSurface] | None = None
        virtual = config.simulation.clock == "virtual"
        device_clock: Clock = VirtualClock() if virtual else RealClock()
        self.clock = TendedClock(device_clock)
        camera = _camera_of(config)
        seen = _Seen.replayed(config, camera) if isinstance(camera, ReplayCameraConfig) else None
        # Of a set that is replayed there is no part.
        self.placement = config.simulation.placement if seen is None else None
        if seen is None:
            seen = _Seen(
                self._rendered(config.simulation.placement),
                SensorModel(bit_depth=config.camera.bits),
                CameraIdentity(),
            )
        faults = config.simulation.faults or FaultPlan()
        rise_ms, fall_ms = config.simulation.led_rise_ms, config.simulation.led_fall_ms
        leds = [Led(rise_ms, fall_ms) for _ in config.lights.tilts_deg]
        self.board = SimulatedBoard(
            device_clock,
            led_count=len(leds),
            leds=faulty_leds(leds, faults.leds, faults.seed, self.clock.now_s())
            if faults.leds
            else leds,
        )
        controller = SimulatedController(
            self.board, device_clock, turn_us=config.simulation.controller_turn_us
        )
        self._controller = (
            FaultyLine(controller, faults.lines, faults.seed) if faults.lines else controller
        )
        self.camera = SimulatedCamera(
            self.board,
            self.clock,
            seen.scene,
            seen.sensor,
            frame_period_s=1.0 / config.camera.frame_rate_hz,
            exposure_s=config.camera.exposure_ms / 1000.0,
            seed=config.simulation.placement.seed,
            readout_s=config.simulation.readout_ms / 1000.0,
            reported_start_s=_driver_stamps(config),
            reported_readout_s=_reported_readout_s(config),
            start_known_to_s=_start_known_to_s(config),
            identity=seen.identity,
            strobe=controller.strobe,
            triggered=config.lights.synchronisation == "trigger",
        )
        self.board.on_trigger(self.camera.trigger)
        self.frames: Camera = self.camera
        if faults.frames:
            self.frames = FaultyCamera(self.camera, self.clock, faults.frames, faults.seed)
        # Last, so that a configuration that is refused above leaves nothing running.
        self._server = self._serve(self._controller)
        self.port = self._server.address
        # None while it is unplugged: the system gives its name to another program's pty.
        self.ports = [self.port]

    def place(self, placement: Placement) -> None:
        """Lay another part, or the same one turned, below the camera.

        Raises
        ------
        InputError
            If the surface is neither a name nor a readable material folder, or a set is replayed.
        """
        if self.placement is None:
            raise InputError(
                f"surface {placement.surface!r} cannot be laid below a camera that replays a set; "
                "set camera.kind = 'simulated'"
            )
        self.camera.look_at(self._rendered(placement), placement.seed)
        self.placement = placement

    def unplug_lights(self) -> None:
        """Pull the controller's cable: its LEDs go out, the port is gone."""
        self._server.stop()
        self.ports.clear()

    def replug_lights(self) -> None:
        """Plug it in again: it boots, and answers on another port than before."""
        self._server.stop()
        self._server = self._serve(self._controller)
        self.port = self._server.address
        self.ports[:] = [self.port]

    def close(self) -> None:
        """Stop the firmware and the camera."""
        self.clock.attend(None)
        self.camera.close()
        self._server.stop()

    def _rendered(self, placement: Placement) -> SceneImages:
        camera = self._config.camera
        size_px = max(camera.width_px, camera.height_px)
        scene = render_frame(
            self._surface_of(placement, size_px),
            self._config.lights.lighting,
            size_px,
            placement.rotate_deg,
            placement.shift_px,
            self._config.simulation.ambient,
        )
        return scene.cropped(camera.height_px, camera.width_px)

    def _surface_of(self, placement: Placement, size_px: int) -> PeriodicSurface:
        name = placement.surface
        key: tuple[object, ...] = (name,)
        if name in SYNTHETIC_TEXTURES:
            key = (name, placement.seed, size_px)
        # The last one is kept, because a surface is mostly captured in many orientations.
        if self._surface is None or self._surface[0] != key:
            self._surface = (key, _load(name, placement.seed, size_px))
        return self._surface[1]


def _camera_of(config: RigConfig) -> SimulatedCameraConfig | ReplayCameraConfig:
    if not isinstance(config.camera, SimulatedCameraConfig | ReplayCameraConfig):
        raise ConfigError(f"camera.kind = {config.camera.kind!r} cannot be simulated")
    return config.camera


def _driver_stamps(config: RigConfig) -> Callable[[int, float], float]:
    """What the rig makes of the simulated driver's time stamps."""
    camera, simulation = _camera_of(config), config.simulation
    require_measured_mode(camera)
    period_s, exposure_s = 1.0 / camera.frame_rate_hz, camera.exposure_ms / 1000.0
    lag_ms = simulation.stamp_lag_ms

    def reported_start_s(sequence: int, start_s: float) -> float:
        if lag_ms is None:
            return exposure_start_s(start_s, True, camera, period_s, exposure_s)
        stamp_s = start_s + lag_ms / 1000.0
        if simulation.stamp_jitter_ms > 0.0:
            rng = np.random.default_rng((simulation.placement.seed, sequence, _JITTER_STREAM))
            stamp_s += rng.uniform(0.0, simulation.stamp_jitter_ms / 1000.0)
        return exposure_start_s(stamp_s, False, camera, period_s, exposure_s)

    return reported_start_s


def _reported_readout_s(config: RigConfig) -> float | None:
    """What the rig knows of the readout: of a simulated driver that stamps without a lag, all."""
    lagging = config.simulation.stamp_lag_ms is not None
    readout_ms = _camera_of(config).readout_ms if lagging else config.simulation.readout_ms
    return None if readout_ms is None else readout_ms / 1e3


def _start_known_to_s(config: RigConfig) -> float:
    if config.simulation.stamp_lag_ms is not None:
        return start_known_to_s(_camera_of(config))
    return max(0.0, -_driver_stamps(config)(0, 0.0))


def _load(name: str, seed: int, size_px: int) -> PeriodicSurface:
    if name in SYNTHETIC_TEXTURES:
        return synthetic_surface(name, seed, tile_side_px(size_px))
    bundled = bundled_materials()
    if name in bundled:
        return load_material(bundled[name])
    folder = Path(name)
    if not folder.is_dir():
        raise InputError(
            f"surface {name!r} is neither a material folder nor one of "
            + ", ".join((*SYNTHETIC_TEXTURES, *bundled))
        )
    return load_material(folder)
