"""The simulated rig as devices: a serial line, and a loopback device or GigE camera for frames.

Any program can open the other end of the line and the camera as a rig.
"""

from collections.abc import Callable
from dataclasses import replace

from classify.base.errors import ConfigError
from firmware_sim import Server, SimulatedController, serve_local, serve_tty
from rig.cameras.config import CameraConfig
from rig.cameras.genicam.fake import FakeGigeCamera
from rig.cameras.genicam.measurement_mode import GenicamCameraConfig
from rig.cameras.genicam.pixel_formats import packed_12p
from rig.cameras.v4l2.measurement_mode import V4l2CameraConfig
from rig.cameras.v4l2.output import V4l2Output
from rig.cameras.v4l2.pixel_formats import PIXEL_FORMATS, PixelFormat
from rig.config.rig import RigConfig
from rig.errors import LightControllerError

from .exposures import Triggered
from .rig import Simulation

# A GigE camera takes its exposure in microseconds.
_EXPOSURE_STEP_MS = 0.0015
# Share of a period.
_PROMPT = 0.25
_GIGE_FORMATS = ("Mono8", "Mono12p", "Mono16")


class DeviceSimulation:
    """A simulated rig in real time, behind a serial or pseudo-terminal and a camera."""

    def __init__(
        self,
        config: RigConfig,
        *,
        serial: str | None,
        video: str | None = None,
        gige: str | None = None,
        lost_packets: float = 0.0,
    ) -> None:
        self._is_triggered = config.lights.synchronisation == "trigger"
        if self._is_triggered and gige is None:
            raise ConfigError(
                "lights.synchronisation = 'trigger', but a loopback device delivers frames at "
                "their own rate; set 'software' or 'strobe', or simulate a GigE camera (--gige)"
            )
        self.written = self.late = 0
        self._period_s = 1.0 / config.camera.frame_rate_hz
        self._format = _writable_format(config.camera, gige is not None)
        self.pixel_format = self._format.name
        real = config.with_changes(
            simulation={"clock": "real"},
            camera={"kind": "simulated", "bits": self._format.bit_depth},
        )
        self._simulation = Simulation(real, _served_at(serial, config))
        self._output: V4l2Output | FakeGigeCamera | None = None
        try:
            if video is not None:
                self._output = self._opened_output(video, config.camera)
            elif gige is not None:
                serial_number = self._simulation.board.serial_number
                camera = FakeGigeCamera(gige, serial_number, self._next_image, lost_packets)
                self._output, self._trigger = camera, camera.trigger
                self._simulation.board.on_trigger(self._pulse)
        except BaseException:
            self._simulation.close()
            raise

    @property
    def port(self) -> str:
        """The serial device or pseudo-terminal at which the firmware answers."""
        return self._simulation.port

    @property
    def writes_frames(self) -> bool:
        """Whether there is a camera."""
        return self._output is not None

    @property
    def lit(self) -> tuple[int, ...]:
        """The LEDs that are on."""
        board, now_s = self._simulation.board, self._simulation.clock.now_s()
        return tuple(led for led in range(board.led_count) if board.output(led, now_s) > 0.5)

    def step(self) -> None:
        """Wait for the end of the next frame and write it; without a video device only wait.

        A GigE camera asks for its frames.

        Frames follow the camera's clock, so that delays do not add up. A frame that is more than a
        period late is left out, so that no burst follows a delay.
        """
        if not isinstance(self._output, V4l2Output):
            self._simulation.clock.sleep_s(self._period_s)
            return
        frame = self._simulation.camera_with_faults.read(2.0 * self._period_s)
        end_s = self._simulation.camera.ready_s(frame.sequence)
        if self._simulation.clock.now_s() - end_s > self._period_s:
            self.late += 1
            return
        assert self._format.to_bytes is not None
        self._output.write(self._format.to_bytes(frame.pixels), end_s)
        self.written += 1

    def close(self) -> None:
        """Put the LEDs out and release the devices; a second call does nothing."""
        try:
            if self._output is not None:
                self._output.close()
        finally:
            self._simulation.close()

    def _pulse(self) -> None:
        """Start an exposure, and let the camera ask for its frame."""
        exposures = self._simulation.camera.exposures
        if isinstance(exposures, Triggered) and exposures.trigger():
            self._trigger()

    def _next_image(self, exposure_ms: float) -> tuple[bytes, int, float]:
        camera = self._simulation.camera_with_faults
        if abs(1e3 * camera.info.exposure_s - exposure_ms) > _EXPOSURE_STEP_MS:
            camera.set_exposure(exposure_ms)
        # A camera that runs free sends what is read out: a frame that has waited is left out.
        while True:
            frame = camera.read(2.0 * self._period_s)
            end_s = self._simulation.camera.ready_s(frame.sequence)
            waited_s = self._simulation.clock.now_s() - end_s
            if self._is_triggered or waited_s < _PROMPT * self._period_s:
                break
            self.late += 1
        self.written += 1
        if self._is_triggered and self._simulation.camera.has_next:
            self._trigger()  # pulses came while this frame was exposed
        assert self._format.to_bytes is not None
        return self._format.to_bytes(frame.pixels), frame.sequence, end_s

    def _opened_output(self, video: str, camera: CameraConfig) -> V4l2Output:
        return V4l2Output(
            video,
            fourcc=self._format.fourcc,
            width_px=camera.width_px,
            height_px=camera.height_px,
            bytes_per_line=camera.width_px * self._format.bytes_per_px,
            period_s=self._period_s,
        )


def _writable_format(camera: CameraConfig, is_gige: bool) -> PixelFormat:
    if camera.recording is not None:
        raise ConfigError(
            "camera.kind = 'replay' cannot be simulated as a device; set 'v4l2' or 'simulated'"
        )
    if isinstance(camera, GenicamCameraConfig) and camera.pixel_format not in _GIGE_FORMATS:
        raise ConfigError(
            f"camera.pixel_format = {camera.pixel_format!r} cannot be simulated; it can be "
            + " or ".join(_GIGE_FORMATS)
        )
    if is_gige and camera.bits == 12:
        return replace(PIXEL_FORMATS["Y12"], name="Mono12p", to_bytes=packed_12p)
    if not isinstance(camera, V4l2CameraConfig):
        return PIXEL_FORMATS["GREY" if camera.bits == 8 else "Y16"]
    form = PIXEL_FORMATS[camera.pixel_format]
    if form.to_bytes is None:
        raise ConfigError(
            f"camera.pixel_format = {camera.pixel_format!r} cannot be written; it can be "
            + ", ".join(name for name, form in PIXEL_FORMATS.items() if form.to_bytes is not None)
        )
    return form


def _served_at(serial: str | None, config: RigConfig) -> Callable[[SimulatedController], Server]:
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
