"""The rig of a station: open, self-test, and one captured set for each part."""

import time
from collections.abc import Callable
from contextlib import suppress

from capture.acquisition.attempts import capture_set
from capture.acquisition.hardware_set import ArrivedPart, wait_for_part
from capture.calibration.ps4cal import CalibrationFile
from capture.calibration.setting import Setting
from capture.sets.captured_set import CapturedSet
from capture.station.domain.config import StationConfig
from capture.station.domain.recipe import Recipe
from capture.station.domain.simulated_parts import simulated_part
from capture.station.judge.inspector import Collector, Inspector
from capture.station.judge.judge import STOP_LED_LEVEL
from classify.base.threads import on_free_processor
from rig import CameraError, HardwareError, Rig, RigConfig, open_rig
from rig.doctor.check import Check
from rig.lights.sequence import detected_part_count

from .self_test import check_rig, check_setting

# Least time from the beginning of the wait to a simulated part: the controller is armed by then.
_SIMULATED_ARRIVAL_S = 0.1
# Number of earlier parts whose pixels a new part is compared with; their hashes take 2 MB.
MAX_KNOWN = 10_000


class StationRig:
    """The rig of a station, with the settings of its recipe, for one thread."""

    def __init__(
        self,
        config: StationConfig,
        rig_config: RigConfig,
        inspector: Inspector | Collector,
    ) -> None:
        self._config, self._base_config, self._inspector = config, rig_config, inspector
        self._rig_config = self._with_camera_of(inspector.recipe)
        self._rig: Rig | None = None
        self._is_simulated = rig_config.is_simulated
        self._part: ArrivedPart | None = None
        # Number of parts that the sensor has detected, and the controller that counts them.
        self._detected, self._controller = 0, ""
        self._number_by_pixels: dict[str, int] = {}  # of the last parts, by the hash of the pixels

    @property
    def is_simulated(self) -> bool:
        """Whether its sets are simulated; the light controller tells when the rig is opened."""
        return self._is_simulated

    @property
    def set_bytes(self) -> int:
        """Size of a set's file."""
        return self._rig_config.set_bytes

    def use(self, inspector: Inspector | Collector) -> None:
        """Use the settings of another recipe; an open rig with other settings is opened again."""
        self._inspector = inspector
        before, self._rig_config = self._rig_config, self._with_camera_of(inspector.recipe)
        if self._rig is not None and self._rig_config != before:
            self.close()
            self.open()

    def open(self) -> None:
        """Open the rig."""
        self._rig = open_rig(self._rig_config)
        self._is_simulated = self._rig.is_simulated

    def test(self, *, is_start: bool) -> list[Check]:
        """Check the open rig; compare it with a white sheet at the start, if configured."""
        has_sheet, rig = is_start and self._config.plate_check, self._opened()
        setting_checks = check_setting(self._inspector.faults_of(Setting.of_rig(rig)))
        return [*setting_checks, *check_rig(rig, self._calibration if has_sheet else None)]

    def wait_for_part(self, number: int, is_over: Callable[[], bool]) -> bool:
        """Wait until the sensor detects a part and its first light is lit; False if `is_over`."""
        rig = self._opened()
        if rig.simulation is not None:
            self._place(number)
            rig.simulation.see_part(max(self._config.timer_s, _SIMULATED_ARRIVAL_S))
        self._part = wait_for_part(rig, self._config.sensor_delay_ms / 1e3, is_over)
        if self._part is None:
            return False
        self._detected += 1
        return True

    def missed_parts(self) -> int:
        """Return the number of parts since the last call that passed while none was awaited."""
        # Parts that pass while the rig is closed count; those before a restart of the controller do
        # not.
        lights = self._opened().lights
        detected, controller = detected_part_count(lights), lights.identity.serial_number
        before, is_same = self._detected, controller == self._controller
        self._detected, self._controller = detected, controller
        if not is_same:
            return 0
        # A restarted controller counts from 0.
        return detected - before if detected >= before else detected

    def forget_part(self) -> None:
        """Drop the part that the sensor detected; the LEDs go out."""
        self._part = None
        self._opened().lights.off()

    @on_free_processor()
    def capture(self, number: int) -> tuple[CapturedSet, float]:
        """Capture the part; return its set, and when the last exposure ended (`time.monotonic`)."""
        rig = self._opened()
        part, self._part = self._part, None
        if part is None:
            self._place(number)
        captured = capture_set(
            rig,
            calibration=self._calibration,
            part=part,
            exposed=self._inspector.begin,
            least_level=STOP_LED_LEVEL,
        )
        self._require_new(captured.metadata.pixels_sha256, number)
        if rig.simulation is not None and self._rig_config.simulation.clock == "virtual":
            return captured, time.monotonic()
        frames = [frame for image in captured.metadata.images for frame in image.frames]
        return captured, max(frame.exposure_end_s for frame in frames)

    def close(self) -> None:
        """Put the LEDs out and release the rig; a closed one stays closed. Never raises."""
        rig, self._rig = self._rig, None
        if rig is not None:
            # A rig that failed may not answer; its watchdog puts the LEDs out.
            with suppress(Exception):
                rig.close()

    @property
    def _calibration(self) -> CalibrationFile | None:
        calibration = self._inspector.calibration
        return None if calibration is None else calibration.file

    def _require_new(self, pixels_sha256: str, number: int) -> None:
        """Raise CameraError for the pixels of an earlier part: noise makes all sets differ."""
        earlier = self._number_by_pixels.setdefault(pixels_sha256, number)
        if earlier != number:
            raise CameraError(
                f"every pixel is that of part number {earlier}: the camera repeats its images; "
                "restart it"
            )
        if len(self._number_by_pixels) > MAX_KNOWN:
            del self._number_by_pixels[next(iter(self._number_by_pixels))]

    def _with_camera_of(self, recipe: Recipe) -> RigConfig:
        """Return the rig with the exposure and gain of a recipe."""
        return self._base_config.with_changes(camera=recipe.light.of_camera)

    def _place(self, number: int) -> None:
        """Put a part below the camera of a simulated rig."""
        simulation, camera = self._opened().simulation, self._rig_config.camera
        if simulation is not None and simulation.placement is not None:
            frame_px = min(camera.width_px, camera.height_px)
            feed = self._config.simulated_parts
            simulation.place(simulated_part(feed, number, frame_px).placement)

    def _opened(self) -> Rig:
        if self._rig is None:
            raise HardwareError("the rig is not open")
        return self._rig
