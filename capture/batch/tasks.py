"""Functions that batches call, each for one captured set.

Each function reads the set from its file and returns a small result without pixels. Paths must be
absolute, because a worker of a cluster has another working folder.
"""

import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from capture.base.console import complain
from capture.base.errors import SetRejected
from capture.calibration.lookup import FoundCalibration
from capture.maps.files import write_maps
from capture.maps.views import RELIT_LIGHT
from capture.sets import ome_tiff
from capture.sets.captured_set import PLANAR, CapturedSet, LoadedSet, calibration_of, naming_file
from capture.sets.metadata import SetMetadata
from classify import Calibration, InputError, Lighting, Match, Method, TextureLibrary
from classify.base.regular_file import read_once
from classify.classifiers import Observation
from classify.images import ImageStack
from classify.library.training import observe
from classify.lights.fall_off import fall_off
from classify.methods import DEFAULT_CLASSIFIER, checked_label, default_method, suits
from classify.surface.estimate import inscribed_square
from classify.texture.spectra import segment_for


@dataclass(frozen=True)
class SetHeader:
    """Metadata of a training set, its solver, and the largest segment of its images."""

    label: str
    orientation_deg: float | None
    simulated: bool
    segment_px: int
    method: Method
    lighting: Lighting
    pixels_sha256: str
    warnings: tuple[str, ...]


def read_header(
    path: Path, method: Method | None = None, calibration: Path | None = None
) -> SetHeader:
    """Read the header of a labelled set, to be solved by `method`, without its pixels."""
    metadata, shape = ome_tiff.read_header(path)
    found_calibration = calibration_of(path, metadata, shape, calibration)
    with naming_file(path):
        label = _usable_label(metadata.label)
        method = _solver(metadata, method)
        segment_px = segment_for(_texture_shape(path, metadata, shape, found_calibration))
        lighting = metadata.lighting.to_lighting()
        if found_calibration is not None:
            lighting = found_calibration.file.calibration.lighting_of(lighting)
    return SetHeader(
        label,
        metadata.orientation_deg,
        metadata.simulated,
        segment_px,
        method,
        lighting,
        metadata.pixels_sha256,
        () if found_calibration is None else found_calibration.warnings,
    )


def warn_of_sets(warnings: Iterable[tuple[Path, tuple[str, ...]]]) -> None:
    """Print each warning once, with the first of the sets that it is about."""
    paths: dict[str, list[Path]] = {}
    for path, texts in warnings:
        for text in texts:
            paths.setdefault(text, []).append(path)
    for text, (first, *others) in paths.items():
        more = f" and {len(others)} more" if others else ""
        complain(f"warning: {first}{more}: {text}")


def observe_set(
    path: Path,
    segment_px: int,
    classifier: str = DEFAULT_CLASSIFIER,
    method: Method | None = None,
    calibration: Path | None = None,
) -> Observation:
    """Solve a set as a planar part and compute its observation for training."""
    loaded = LoadedSet.of(path, calibration)
    with naming_file(path):
        surface = loaded.solve_texture(method, planar=PLANAR)
        return observe(surface.inscribed, segment_px, classifier)


@dataclass(frozen=True)
class ClassifiedSet:
    """The match of a set, how it was solved, and fields of its metadata."""

    match: Match
    method: Method
    planar: bool
    label: str | None
    orientation_deg: float | None
    simulated: bool
    is_training_set: bool  # whether the library was trained from a set of the same pixels
    warnings: tuple[str, ...]


def classify_set(
    path: Path,
    library: Path,
    label_required: bool = False,
    method: Method | None = None,
    calibration: Path | None = None,
) -> ClassifiedSet:
    """Classify a set that is solved by `method`.

    None stands for the method of the library if that suits the number of lights, and else for the
    default of these lights.
    """
    loaded = LoadedSet.of(path, calibration)
    captured, metadata = loaded.captured, loaded.captured.metadata
    trained = _read_library(library)
    with naming_file(path):
        if label_required:
            _usable_label(metadata.label)
        if method is None and trained.method and suits(trained.method, len(captured.images)):
            method = trained.method
        method = _solver(metadata, method)
        surface = loaded.solve_texture(method, planar=trained.planar)
        with warnings.catch_warnings():
            # The commands warn once for all sets.
            warnings.simplefilter("ignore")
            match = trained.classify(surface)
    return ClassifiedSet(
        match,
        method,
        surface.planar,
        metadata.label,
        metadata.orientation_deg,
        metadata.simulated,
        any(metadata.pixels_sha256 == pixels_sha256 for _, pixels_sha256 in trained.sources),
        loaded.warnings,
    )


@dataclass(frozen=True)
class SolveTask:
    """A set and the folder for its maps."""

    path: Path
    folder: Path

    def __str__(self) -> str:
        return str(self.path)


@dataclass(frozen=True)
class SolvedSet:
    """Names of the written files, shares of the pixels from 0 to 1, and fields of the set."""

    files: tuple[str, ...]
    valid: float
    saturated: float
    shadowed: float
    planar: bool
    # Share by which a light falls off across a flat part, divided out if `planar`; None where too
    # little of the part is lit.
    fall_off: float | None
    led_levels: tuple[float, ...] | None  # estimated from the images; None if the set gives them
    simulated: bool
    lights: int
    mm_per_px: float | None
    calibration: str | None  # its file
    residual: float | None  # median difference of the images from the solution, share of the signal
    raw_residual: float | None  # the same without the calibration
    warnings: tuple[str, ...]


def solve_set(
    task: SolveTask,
    method: Method | None,
    light: Lighting = RELIT_LIGHT,
    *,
    planar: bool = False,
    calibration: Path | None = None,
    raw: bool = False,
    on_progress: Callable[[float], None] | None = None,
) -> SolvedSet:
    """Solve a set and write its maps; see `LoadedSet.of` and `LoadedSet.solve`."""
    loaded = LoadedSet.of(task.path, calibration, raw=raw)
    captured, found_calibration = loaded.captured, loaded.found_calibration
    with naming_file(task.path):
        surface = loaded.solve(method, planar=planar, uncertainty=True, on_progress=on_progress)
        raw_residual = None
        if found_calibration is not None:
            raw_residual = captured.solve(method, planar=planar, raw=True).residual_share
    saturated = float(surface.saturated.mean())
    shadowed = float(surface.shadow_mask.mean())
    if not surface.valid.any():
        raise SetRejected(
            f"{task.path}: no pixel can be solved: {saturated:.0%} are saturated, "
            f"{1.0 - saturated:.0%} too dark or outside of the mask; check exposure, lights and "
            "mask"
        )
    flat_fall_off = surface.fall_off
    if not planar and surface.divided_by is None:
        stack = ImageStack(captured.images, captured.ambient)
        flat_fall_off = fall_off(stack, captured.lighting, surface.full_scale, captured.mask)
    levels = surface.led_levels
    written = write_maps(
        captured,
        surface,
        task.folder,
        light=light,
        mm_per_px=loaded.mm_per_px,
        calibration=found_calibration,
        raw_residual=raw_residual,
        inputs=[task.path, *([] if found_calibration is None else [found_calibration.path])],
    )
    return SolvedSet(
        files=tuple(path.name for path in written),
        valid=float(surface.valid.mean()),
        saturated=saturated,
        shadowed=shadowed,
        planar=planar,
        fall_off=None if flat_fall_off is None else flat_fall_off.largest_fall_off,
        led_levels=None if levels is None else tuple(np.round(levels, 4).tolist()),
        simulated=captured.metadata.simulated,
        lights=len(captured.images),
        mm_per_px=loaded.mm_per_px,
        calibration=None if found_calibration is None else str(found_calibration.path),
        residual=surface.residual_share,
        raw_residual=raw_residual,
        warnings=loaded.warnings,
    )


def _texture_shape(
    path: Path,
    metadata: SetMetadata,
    shape: tuple[int, int],
    found_calibration: FoundCalibration | None,
) -> tuple[int, int]:
    """Rows and columns of the square in which the texture of a set is observed."""
    mask = None if metadata.mask_file is None else CapturedSet.load(path).mask
    if mask is None:
        return shape
    calibration = Calibration() if found_calibration is None else found_calibration.file.calibration
    rows, columns = inscribed_square(calibration.corrected_mask(mask))
    return rows.stop - rows.start, columns.stop - columns.start


def _usable_label(label: str | None) -> str:
    if not label:
        raise InputError(
            "has no label; capture or import it with --label, or give it one with ps4rig info "
            "--set label=NAME"
        )
    return checked_label(label)


def _solver(metadata: SetMetadata, method: Method | None) -> Method:
    """`method` or the default for the number of lights, if it suits that number."""
    count = len(metadata.lighting.directions)
    chosen = method or default_method(count)
    if not suits(chosen, count):
        advice = "give --method least_squares" if count >= 3 else "3 are needed"
        raise InputError(f"has {count} lights, which {chosen} cannot solve; {advice}")
    return chosen


@read_once(files=1)
def _read_library(path: Path) -> TextureLibrary:
    return TextureLibrary.load(path)
