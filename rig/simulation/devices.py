"""The simulated rig as devices: a serial line, and a camera of one kind.

Any program can open the other end of the line and the camera as a rig.
"""

from collections.abc import Callable
from functools import partial

from classify.base.errors import ConfigError
from firmware_sim import Server, SimulatedController, serve_local, serve_tty
from rig.cameras.kinds import CAMERA_KINDS
from rig.cameras.served import ServedCamera, ServedFrame, TriggeredCamera
from rig.config.rig import RigConfig
from rig.errors import LightControllerError

from .rig import Simulation

# Exposures that differ by less are equal: devices take whole microseconds.
_EXPOSURE_STEP_MS = 0.0015


class DeviceSimulation:
    """A simulated rig in real time behind a serial device or pseudo-terminal, and a camera.

    `served` is KIND:PLACE of the camera, None for no camera.
    """

    def __init__(self, config: RigConfig, *, serial: str | None, served: str | None) -> None:
        if config.camera.recording is not None:
            raise ConfigError(
                "camera.kind = 'replay' cannot be simulated as a device; set 'v4l2' or 'simulated'"
            )
        camera = None if served is None else _served_camera(config, served)
        self._triggered: TriggeredCamera | None = None  # None for a camera that runs free
        if config.lights.synchronisation == "trigger":
            if not isinstance(camera, TriggeredCamera):
                raise ConfigError(
                    "lights.synchronisation = 'trigger' needs a camera with a trigger input; give "
                    f"--camera {camera_choices('trigger')}, or set 'software' or 'strobe'"
                )
            self._triggered = camera
        self.written_count = self.late_count = 0
        self._period_s = 1.0 / config.camera.frame_rate_hz
        bits = config.camera.bits if camera is None else camera.bit_depth
        real_time = config.with_changes(
            simulation={"clock": "real"}, camera={"kind": "simulated", "bits": bits}
        )
        self._simulation = Simulation(real_time, _server_at(serial, config))
        self.serial_number = self._simulation.board.serial_number
        self.camera: ServedCamera | None = None
        try:
            if camera is not None:
                camera.start(self)
                self.camera = camera
            if self._triggered is not None:
                self._simulation.board.on_trigger(partial(self._pulse, self._triggered))
        except BaseException:
            self._simulation.close()
            raise

    @property
    def port(self) -> str:
        """The serial device or pseudo-terminal at which the firmware answers."""
        return self._simulation.port

    @property
    def lit(self) -> tuple[int, ...]:
        """The LEDs that are on."""
        board, now_s = self._simulation.board, self._simulation.clock.now_s()
        return tuple(led for led in range(board.led_count) if board.output(led, now_s) > 0.5)

    def step(self) -> None:
        """Serve the next frame, or wait for a frame period."""
        if self.camera is None:
            self._simulation.clock.sleep_s(self._period_s)
        else:
            self.camera.step()

    def next_frame(
        self, max_late_periods: float, exposure_ms: float | None = None
    ) -> ServedFrame | None:
        """Wait for a frame by the camera's clock, so that delays do not add up."""
        simulation = self._simulation
        source = simulation.camera_with_faults
        current_ms = 1e3 * source.info.exposure_s
        if exposure_ms is not None and abs(current_ms - exposure_ms) > _EXPOSURE_STEP_MS:
            source.set_exposure(exposure_ms)
        frame = source.read(2.0 * self._period_s)
        end_s = simulation.camera.ready_s(frame.sequence)
        late_s = simulation.clock.now_s() - end_s
        if self._triggered is None and late_s > max_late_periods * self._period_s:
            self.late_count += 1
            return None
        self.written_count += 1
        if self._triggered is not None and simulation.camera.has_next:
            self._triggered.trigger()  # pulses came while this frame was exposed
        return ServedFrame(frame.pixels, frame.sequence, end_s)

    def close(self) -> None:
        """Put the LEDs out and release the devices; a second call does nothing."""
        try:
            if self.camera is not None:
                self.camera.close()
        finally:
            self._simulation.close()

    def _pulse(self, camera: TriggeredCamera) -> None:
        """Start an exposure, and let the camera request its frame."""
        if self._simulation.camera.exposures.trigger():
            camera.trigger()


def camera_choices(method: str = "start") -> str:
    """The values of `--camera` whose served cameras have a method."""
    return " or ".join(
        f"{name}:{kind.served.place_help}"
        for name, kind in CAMERA_KINDS.items()
        if kind.served is not None and hasattr(kind.served, method)
    )


def _served_camera(config: RigConfig, served: str) -> ServedCamera:
    name, _, place = served.partition(":")
    kind = CAMERA_KINDS.get(name)
    if kind is None or kind.served is None or not place:
        raise ConfigError(f"--camera {served}: give {camera_choices()}")
    return kind.served(place, config.camera)


def _server_at(serial: str | None, config: RigConfig) -> Callable[[SimulatedController], Server]:
    if serial is None:
        return serve_local

    def serve(controller: SimulatedController) -> Server:
        try:
            return serve_tty(controller, serial, config.lights.baud)
        except ImportError as error:
            raise ConfigError(
                f"{serial}: serial devices are served on Linux only ({error}); leave --serial out"
            ) from error
        except BlockingIOError as error:
            raise LightControllerError(f"{serial}: in use by another program") from error
        except OSError as error:
            raise LightControllerError(
                f"{serial}: cannot be served as a serial device ({error.strerror})"
            ) from error
        except ValueError as error:
            raise ConfigError(f"lights.baud: {error}") from error

    return serve
