"""The rig of a station: opened and tested, a part in place, one captured set for each part."""

import time
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from capture.acquisition.attempts import capture_set
from capture.calibration.lookup import read_calibration
from capture.sets.captured_set import CapturedSet
from rig import HardwareError, Rig, RigConfig, open_rig
from rig.doctor.check import Check

from .config import StationConfig
from .recipe import Recipe
from .self_test import check_rig
from .simulated_parts import simulated_part


class PartCamera(Protocol):
    """What the cycle knows of the rig. All methods are called from one thread."""

    @property
    def is_simulated(self) -> bool:
        """Whether its sets are simulated."""

    def open(self) -> None:
        """Open the rig, which is closed."""

    def test(self, *, is_start: bool) -> list[Check]:
        """Check the open rig; with the plate, if there is one, only at the start."""

    def capture(self, number: int) -> tuple[CapturedSet, float]:
        """Capture the part with this number; the time is the end of the last exposure.

        The time is that of `time.monotonic`.
        """

    def close(self) -> None:
        """Put the LEDs out and release the rig; a closed one stays closed. Never raises."""


class StationRig:
    """The rig of a station, with the settings of its recipe.

    Parameters
    ----------
    config
        The station.
    rig_config
        The rig.
    recipe
        Its exposure and gain replace those of the rig.
    """

    def __init__(self, config: StationConfig, rig_config: RigConfig, recipe: Recipe) -> None:
        wanted = recipe.light.model_dump(exclude_none=True)
        self._config = config
        self._rig_config = rig_config.with_changes(camera=wanted) if wanted else rig_config
        self._rig: Rig | None = None
        path = rig_config.calibration
        self.calibration = None if path is None else read_calibration(Path(path))

    @property
    def is_simulated(self) -> bool:
        """Whether its sets are simulated."""
        return self._rig_config.is_simulated

    def open(self) -> None:
        """Open the rig.

        Raises
        ------
        HardwareError
            If it cannot be opened.
        """
        self._rig = open_rig(self._rig_config)

    def test(self, *, is_start: bool) -> list[Check]:
        """Check the open rig; with the plate, if there is one, only at the start."""
        with_plate = is_start and self._config.plate_check
        return check_rig(self._opened(), self.calibration if with_plate else None)

    def capture(self, number: int) -> tuple[CapturedSet, float]:
        """Capture the part with this number, which a simulated rig puts below its camera first.

        The time is the end of the last exposure. On a virtual clock it is the time of the return.

        Raises
        ------
        SetRejected, CalibrationError, HardwareError
            As `capture_set`.
        """
        rig = self._opened()
        simulation, camera = rig.simulation, self._rig_config.camera
        if simulation is not None and simulation.placement is not None:
            frame_px = min(camera.width_px, camera.height_px)
            feed = self._config.simulated_parts
            simulation.place(simulated_part(feed, number, frame_px).placement)
        captured = capture_set(rig, calibration=self.calibration)
        if simulation is not None and self._rig_config.simulation.clock == "virtual":
            return captured, time.monotonic()
        frames = [frame for image in captured.metadata.images for frame in image.frames]
        return captured, max(frame.exposure_end_s for frame in frames)

    def close(self) -> None:
        """Put the LEDs out and release the rig; a closed one stays closed."""
        rig, self._rig = self._rig, None
        if rig is not None:
            # Nothing is known of a rig that failed; its watchdog puts the LEDs out.
            with suppress(Exception):
                rig.close()

    def _opened(self) -> Rig:
        if self._rig is None:
            raise HardwareError("the rig is not open")
        return self._rig
