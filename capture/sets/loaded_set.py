"""`LoadedSet`: a captured set with its calibration, ready to be solved."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from capture.calibration.lookup import FoundCalibration
from classify import Method, SurfaceEstimate
from classify.base.errors import InputError
from classify.calibration.calibration import Calibration

from .captured_set import CapturedSet, calibration_of

# Training sets are solved as planar parts: near lights fall off, textures have no tilt or bow.
PLANAR = True


@dataclass(frozen=True, eq=False)
class LoadedSet:
    """A captured set with its calibration, if it has one."""

    captured: CapturedSet
    found_calibration: FoundCalibration | None

    @classmethod
    def of(cls, path: Path, calibration: Path | None = None, *, raw: bool = False) -> Self:
        """Load a set with `calibration`, or the one that it names, or if `raw` with none."""
        captured = CapturedSet.load(path)
        metadata, shape = captured.metadata, captured.images.shape[1:]
        return cls(captured, None if raw else calibration_of(path, metadata, shape, calibration))

    @property
    def calibration(self) -> Calibration | None:
        """The calibration of the rig; None without one."""
        return None if self.found_calibration is None else self.found_calibration.file.calibration

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the calibration."""
        return () if self.found_calibration is None else self.found_calibration.warnings

    def solve_texture(self, method: Method | None, *, planar: bool) -> SurfaceEstimate:
        """Solve a part with a texture.

        With a flat field in the calibration, no fall-off is fitted to the part.
        """
        has_flat_field = self.calibration is not None and self.calibration.flat_field is not None
        return self.solve(method, planar=planar and not has_flat_field)

    def solve(self, method: Method | None = None, *, planar: bool = False) -> SurfaceEstimate:
        """Solve with the calibration, or without one if there is none."""
        calibration = self.calibration
        return self.captured.solve(
            method, planar=planar, calibration=calibration, raw=calibration is None
        )


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Put the name of the file in front of the message of an `InputError`."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
