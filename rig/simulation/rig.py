"""The simulated rig below the drivers: firmware on a TCP port, LEDs, part, camera."""

from collections.abc import Callable

from classify.base.errors import ConfigError, InputError
from firmware_sim import (
    Clock,
    RealClock,
    Server,
    SimulatedBoard,
    SimulatedController,
    VirtualClock,
    serve_tcp,
)
from firmware_sim.board import Led
from firmware_sim.faults import FaultyLine, faulty_leds
from rig.cameras.camera import Camera
from rig.cameras.config import ReplayCameraConfig, SimulatedCameraConfig
from rig.config.rig import RigConfig
from rig.config.simulation import FaultPlan, Placement
from rig.lights.keep_alive import KeepAliveClock

from .camera import (
    Exposures,
    FreeRunning,
    LitScene,
    Shutter,
    SimulatedCamera,
    Triggered,
    reported_timing,
)
from .frame_faults import FaultyCamera
from .scenes import SceneRenderer
from .sensor import Sensor, SensorModel


class Simulation:
    """The hardware of a simulated rig.

    Parameters
    ----------
    config
        The rig. Its lights and camera are simulated even if they are configured as real.
    serve
        Starts the firmware and returns its address.

    Attributes
    ----------
    port
        Address at which the light controller's firmware answers.
    ports
        List that holds `port`, for discovery; empty while the controller is unplugged, because the
        system may give its number to another program.
    controller
        The firmware, with the configured faults of its line.
    board
        The controller's board, with the true output of the LEDs.
    camera
        The camera above the part.
    camera_with_faults
        The camera with the configured faults, from which a program reads.
    placement
        The part below the camera, None if the camera replays a captured set.
    """

    def __init__(
        self, config: RigConfig, serve: Callable[[SimulatedController], Server] = serve_tcp
    ) -> None:
        self._config = config
        self._serve = serve
        self._renderer = SceneRenderer(config)
        virtual = config.simulation.clock == "virtual"
        device_clock: Clock = VirtualClock() if virtual else RealClock()
        self.clock = KeepAliveClock(device_clock)
        camera = config.camera
        if not isinstance(camera, SimulatedCameraConfig | ReplayCameraConfig):
            raise ConfigError(
                f"camera.kind = {camera.kind!r} cannot be simulated; set 'simulated' or 'replay'"
            )
        placement = config.simulation.placement
        self.placement = placement if isinstance(camera, SimulatedCameraConfig) else None
        scene, sensor = self._scene_and_sensor(camera)
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
        pass_us = config.simulation.controller_turn_us
        self.controller = (
            FaultyLine(self.board, device_clock, faults.lines, faults.seed, pass_us)
            if faults.lines
            else SimulatedController(self.board, device_clock, pass_us=pass_us)
        )
        self.camera = SimulatedCamera(
            self.board,
            self.clock,
            scene,
            sensor,
            self._exposures(),
            seed=placement.seed,
            reported=reported_timing(camera, config.simulation),
        )
        self.camera_with_faults: Camera = self.camera
        if faults.frames:
            self.camera_with_faults = FaultyCamera(
                self.camera, self.clock, faults.frames, faults.seed
            )
        # Last, so that an error above leaves nothing running.
        self._server = self._serve(self.controller)
        self.port = self._server.address
        self.ports = [self.port]

    def place(self, placement: Placement) -> None:
        """Put another part, or the same one rotated, below the camera.

        Raises
        ------
        InputError
            If the surface is neither a name nor a readable material folder, or a set is replayed.
        """
        if self.placement is None:
            raise InputError(
                f"surface {placement.surface!r} cannot be put below a camera that replays a set; "
                "set camera.kind = 'simulated'"
            )
        self.camera.replace_scene(self._renderer.render(placement), placement.seed)
        self.placement = placement

    def see_part(self, in_s: float = 0.0) -> None:
        """Let the part sensor see a part after `in_s` seconds."""
        at_s = self.clock.now_s() + in_s
        self.clock.call_at(at_s, lambda: self.board.see_part(at_s))

    def unplug_lights(self) -> None:
        """Unplug the controller: its LEDs go out, and its port disappears."""
        self._server.stop()
        self.ports.clear()

    def replug_lights(self) -> None:
        """Plug the controller in again: it boots, and answers on another port."""
        self._server.stop()
        self._server = self._serve(self.controller)
        self.port = self._server.address
        self.ports[:] = [self.port]

    def close(self) -> None:
        """Stop the firmware and the camera."""
        self.clock.keep_alive_with(None)
        self.camera.close()
        self._server.stop()

    def _scene_and_sensor(
        self, camera: SimulatedCameraConfig | ReplayCameraConfig
    ) -> tuple[LitScene, Sensor]:
        if isinstance(camera, SimulatedCameraConfig):
            placement = self._config.simulation.placement
            simulated = self._config.simulation
            sensor = SensorModel(
                bit_depth=camera.bits,
                response_gamma=simulated.response_gamma,
                hot_pixels=simulated.hot_pixels,
            )
            return self._renderer.render(placement), sensor
        # Imported here, so that other rigs open without tifffile.
        from .recorded_set import read_recorded_set

        recorded = read_recorded_set(camera.recording, camera.exposure_ms)
        recorded.require_lighting(self._config.lights.lighting)
        return recorded, recorded.sensor

    def _exposures(self) -> Exposures:
        config = self._config
        shutter = Shutter(
            1.0 / config.camera.frame_rate_hz,
            config.camera.exposure_ms / 1e3,
            config.simulation.readout_ms / 1e3,
        )
        triggered = config.lights.synchronisation == "trigger"
        exposures = (Triggered if triggered else FreeRunning)(
            self.clock, shutter, self.board.strobe
        )
        self.board.on_trigger(exposures.trigger)
        return exposures
