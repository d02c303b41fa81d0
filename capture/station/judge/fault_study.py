"""Fault study: the strength from which a recipe finds faults that are made in good parts."""

import math
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from capture.sets.captured_set import CapturedSet, LoadedSet
from capture.station.domain.errors import RecipeError
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import RecipeFolder
from capture.station.domain.taught import taught_for
from capture.station.domain.verdict import Decision
from classify.base.errors import InputError
from classify.base.models import Record
from classify.confidence import CONFIDENCE, share_at_least

from .fingerprint import Fingerprint
from .inspector import Inspector

_MIN_FOUND_SHARE = 0.9
"""Share of the parts with a fault that must not pass for it to count as found."""
_LARGE_STRENGTH = 0.2
"""Size of a large fault, as a share of the frame; a recipe must find it to be approved."""

# Number of good parts of each texture that are studied for an approval.
_PARTS = 3
_MIDDLE_SHARE = 0.25  # largest offset of a fault from the middle of the frame, as a share of it
_MAX_BYTES = 1 << 20
_Images = npt.NDArray[np.float32]
_Unit = Literal["of the frame", "of the taught value"]

# Sizes of faults as shares of the frame's shorter side; every recipe must find the last one.
_SIZES = (0.06, 0.1, 0.2)
_CONTRAST = 0.3  # of a stain
_DEPTH_PER_SIZE = 0.1  # of a dent
_EDGE_PX = 3.0  # width of the soft edge of a piece
_SAME_TILT_DEG = 3.0  # largest difference of the tilts of lights that replace each other


@dataclass(frozen=True)
class Place:
    """Middle of a fault in px from the middle of the frame; direction of a strip."""

    x_px: float
    y_px: float
    angle_deg: float


@dataclass(frozen=True)
class _MadeFault:
    """A kind of fault with three strengths."""

    name: str
    unit: _Unit  # of a strength: size of the fault, or factor of the whole part
    strengths: tuple[float, float, float]
    # Makes images with the fault from images without ambient light, tilts of the lights in degrees,
    # strength and place; None if the lights do not allow the fault.
    make: Callable[[_Images, npt.NDArray[np.float64], float, Place], _Images | None]
    needs_handedness: bool = False  # invisible on a texture that looks like its mirror image
    needs_direction: bool = False  # hardly visible on a texture that looks alike at 90 degrees

    @property
    def is_local(self) -> bool:
        """Whether it covers a piece of the part."""
        return self.unit == "of the frame"


def with_fault(
    captured: CapturedSet, fault: _MadeFault, strength: float, place: Place
) -> CapturedSet | None:
    """Return the set of a good part with a fault; None if its lights do not allow the fault."""
    dark = 0.0 if captured.ambient is None else captured.ambient.astype(np.float32)
    signals = captured.images.astype(np.float32) - dark
    changed = fault.make(signals, captured.lighting.tilts_deg, strength, place)
    if changed is None:
        return None
    values = np.clip(np.rint(changed + dark), 0.0, captured.metadata.full_scale)
    return replace(captured, images=values.astype(np.uint16))


def _from_middle(images: _Images, place: Place) -> tuple[_Images, _Images]:
    """Coordinates in px from the middle of a fault, x to the right and y up."""
    rows, columns = images.shape[1:]
    x = np.arange(columns, dtype=np.float32) - np.float32(0.5 * (columns - 1) + place.x_px)
    y = np.float32(0.5 * (rows - 1) - place.y_px) - np.arange(rows, dtype=np.float32)
    return x, y[:, None]


def _side_px(images: _Images) -> int:
    return int(min(images.shape[1:]))


def _disc(images: _Images, size: float, place: Place) -> _Images:
    """Weight of a round piece, with a soft edge."""
    x, y = _from_middle(images, place)
    inside = np.float32(0.5 * size * _side_px(images)) - np.hypot(x, y)
    return np.asarray(np.clip(inside / np.float32(_EDGE_PX) + 0.5, 0.0, 1.0), np.float32)


def _blended(images: _Images, other: _Images, weight: _Images) -> _Images:
    return np.asarray(images + weight * (other - images), np.float32)


def _smooth(images: _Images, sigma_px: float) -> _Images:
    return np.stack([cv2.GaussianBlur(image, (0, 0), sigma_px) for image in images])


def _hole(images: _Images, _: Any, size: float, place: Place) -> _Images:
    weight = _disc(images, size, place)
    means = (images * weight).sum(axis=(1, 2)) / weight.sum()
    return _blended(images, np.broadcast_to(means[:, None, None], images.shape), weight)


def _strip(images: _Images, _: Any, size: float, place: Place) -> _Images:
    x, y = _from_middle(images, place)
    angle = math.radians(place.angle_deg)
    across = np.abs(np.float32(math.cos(angle)) * x + np.float32(math.sin(angle)) * y)
    inside = np.float32(0.5 * size * _side_px(images)) - across
    weight = np.clip(inside / np.float32(_EDGE_PX) + 0.5, 0.0, 1.0).astype(np.float32)
    return _blended(images, _smooth(images, 8.0), weight)


def _stain(images: _Images, _: Any, size: float, place: Place) -> _Images:
    return _blended(images, images * np.float32(1.0 - _CONTRAST), _disc(images, size, place))


def _dent(images: _Images, tilts_deg: Any, size: float, place: Place) -> _Images:
    """Slopes of a raised cosine, added to the shading at a slant of 45 degrees."""
    x, y = _from_middle(images, place)
    radius = 0.5 * size * _side_px(images)
    phase = np.pi * np.minimum(np.hypot(x, y) / radius, 1.0)
    depth = _DEPTH_PER_SIZE * 2.0 * radius
    slope = 0.5 * depth * (np.pi / radius) ** 2 * np.sinc(phase / np.pi)
    tilts = np.radians(tilts_deg)[:, None, None]
    towards = np.cos(tilts) * (slope * x) + np.sin(tilts) * (slope * y)
    return np.asarray(images - towards * images.mean(axis=0), np.float32)


def _rotated(images: _Images, tilts_deg: Any, size: float, place: Place) -> _Images | None:
    lights = _source_lights(tilts_deg, lambda tilt_deg: tilt_deg - 90.0)
    if lights is None:
        return None
    side = _side_px(images)
    square = images[:, :side, :side]
    other = images.copy()
    other[:, :side, :side] = np.rot90(square, axes=(1, 2))[lights]
    return _blended(images, other, _disc(images, size, place))


def _mirrored(images: _Images, tilts_deg: Any, size: float, place: Place) -> _Images | None:
    lights = _source_lights(tilts_deg, lambda tilt_deg: 180.0 - tilt_deg)
    if lights is None:
        return None
    other = images[:, :, ::-1][lights]
    return other if size >= 1.0 else _blended(images, other, _disc(images, size, place))


def _source_lights(tilts_deg: Any, source_deg: Callable[[float], float]) -> list[int] | None:
    """Index of the light at the tilt `source_deg` of each light's tilt; None if one is missing.

    A piece that is moved keeps its shading: under each light it shows the image of its source.
    """
    lights = []
    for tilt_deg in tilts_deg.tolist():
        differences_deg = np.abs((tilts_deg - source_deg(tilt_deg) + 180.0) % 360.0 - 180.0)
        if differences_deg.min() > _SAME_TILT_DEG:
            return None
        lights.append(int(differences_deg.argmin()))
    return lights


def _scaled(images: _Images, _: Any, factor: float, __: Place) -> _Images:
    rows, columns = images.shape[1:]
    matrix = cv2.getRotationMatrix2D((0.5 * (columns - 1), 0.5 * (rows - 1)), 0.0, factor)
    return np.stack([
        cv2.warpAffine(
            image, matrix, (columns, rows), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
        )
        for image in images
    ])  # fmt: skip


def _darker(images: _Images, _: Any, factor: float, __: Place) -> _Images:
    return images * np.float32(factor)


def _deeper(images: _Images, _: Any, factor: float, __: Place) -> _Images:
    mean = images.mean(axis=0)
    return np.asarray(mean + np.float32(factor) * (images - mean), np.float32)


FAULTS: tuple[_MadeFault, ...] = (
    _MadeFault("hole", "of the frame", _SIZES, _hole),
    _MadeFault("worn strip", "of the frame", _SIZES, _strip),
    _MadeFault("stain of 30 %", "of the frame", _SIZES, _stain),
    _MadeFault("dent", "of the frame", _SIZES, _dent),
    _MadeFault("rotated piece", "of the frame", _SIZES, _rotated, needs_direction=True),
    _MadeFault("mirrored piece", "of the frame", (0.2, 0.5, 1.0), _mirrored, needs_handedness=True),
    _MadeFault("other scale", "of the taught value", (1.02, 1.05, 1.1), _scaled),
    _MadeFault("darker", "of the taught value", (0.9, 0.75, 0.5), _darker),
    _MadeFault("deeper relief", "of the taught value", (1.1, 1.2, 1.4), _deeper),
)
"""One row for each kind of fault; the strengths rise."""


class FaultFinding(Record):
    """How many parts of a texture with a fault of one strength did not pass."""

    texture: str
    fault: str
    unit: str
    strength: float
    found: int
    parts: int

    @property
    def is_found(self) -> bool:
        """Whether at least `_MIN_FOUND_SHARE` of the parts did not pass."""
        return self.found >= _MIN_FOUND_SHARE * self.parts

    def __str__(self) -> str:
        return f"{self.fault}, {self.strength:g} {self.unit}, on {self.texture}"


class FaultStudy(Record):
    """The findings of one recipe, with hashes of all that they depend on."""

    format: Literal["ps4rig-faults"] = "ps4rig-faults"
    version: Literal[1] = 1
    fingerprint: Fingerprint
    findings: tuple[FaultFinding, ...]

    def passing(self, recipe: Recipe) -> tuple[FaultFinding, ...]:
        """Faults of `_LARGE_STRENGTH` size that pass and that a recipe does not acknowledge."""
        return tuple(
            finding
            for finding in self.findings
            if finding.unit == "of the frame"
            and finding.strength == _LARGE_STRENGTH
            and not finding.is_found
            and finding.fault not in recipe.acknowledged
        )

    def lines(self) -> list[str]:
        """Lines for each texture and fault: the strength from which the fault is found."""
        lines = []
        for texture, fault in dict.fromkeys(
            (finding.texture, finding.fault) for finding in self.findings
        ):
            rows = [row for row in self.findings if (row.texture, row.fault) == (texture, fault)]
            counts = ", ".join(f"{row.strength:g}: {row.found} of {row.parts}" for row in rows)
            # From the weakest strength on, all stronger faults are found too.
            found_rows = [row for n, row in enumerate(rows) if all(r.is_found for r in rows[n:])]
            outcome = f"is not found ({counts})"
            if found_rows:
                weakest = found_rows[0]
                fewest = min(found_rows, key=lambda row: row.found / row.parts)
                found_share = share_at_least(fewest.found, fewest.parts)
                outcome = (
                    f"is found from {weakest.strength:g} {weakest.unit} on ({counts}); "
                    f"{fewest.found} of {fewest.parts} show, with {CONFIDENCE:.0%} confidence, "
                    f"that {found_share:.0%} or more are found"
                )
            lines.append(f"{texture}: {fault} {outcome}")
        return lines


def study_faults(
    files: RecipeFolder, inspector: Inspector, parts: int, *, large_only: bool = False
) -> Iterator[FaultFinding]:
    """Judge good parts that pass, at most `parts` of each texture, with each of `FAULTS`.

    With `large_only`, only faults of `_LARGE_STRENGTH`.
    """
    taught = taught_for(inspector.recipe, files)
    rng = random.Random(1)
    for texture in inspector.recipe.passes:
        good: list[tuple[LoadedSet, Inspector]] = []
        for taught_set in taught.textures[texture].sets:
            path = files.sets / taught_set.file
            if len(good) < parts and path.is_file():
                loaded = LoadedSet.of(path)
                judge = inspector.with_calibration(loaded.found_calibration)
                if judge.inspect(loaded.captured).verdict.decision is Decision.PASS:
                    good.append((loaded, judge))
        limits = inspector.recipe.limits_for(texture)
        for fault in FAULTS:
            if fault.needs_handedness and limits.handedness is None:
                continue
            for strength in fault.strengths:
                if large_only and not (fault.is_local and strength == _LARGE_STRENGTH):
                    continue
                outcomes = [_passes(judge, loaded, fault, strength, rng) for loaded, judge in good]
                have_passed = [outcome for outcome in outcomes if outcome is not None]
                finding = FaultFinding(
                    texture=texture,
                    fault=fault.name,
                    unit=fault.unit,
                    strength=strength,
                    found=have_passed.count(False),
                    parts=len(have_passed),
                )
                # Without a direction, a rotated piece is visible at most at its edge.
                may_pass = fault.needs_direction and not inspector.has_direction(texture)
                if have_passed and (finding.is_found or not may_pass):
                    yield finding


def _passes(
    inspector: Inspector, loaded: LoadedSet, fault: _MadeFault, strength: float, rng: random.Random
) -> bool | None:
    """Whether a part with a fault passes; None if the lights of its set do not allow the fault."""
    rows, columns = loaded.captured.images.shape[1:]
    place = Place(
        rng.uniform(-_MIDDLE_SHARE, _MIDDLE_SHARE) * columns,
        rng.uniform(-_MIDDLE_SHARE, _MIDDLE_SHARE) * rows,
        rng.uniform(0.0, 180.0),
    )
    captured = with_fault(loaded.captured, fault, strength, place)
    if captured is None:
        return None
    return inspector.inspect(captured).verdict.decision is Decision.PASS


def _fingerprint(inspector: Inspector) -> Fingerprint:
    """Fingerprint without a calibration: each set is judged with its own calibration."""
    return inspector.with_calibration(None).fingerprint


def kept_study(files: RecipeFolder, inspector: Inspector) -> FaultStudy | None:
    """The last study of exactly this recipe; None without one."""
    try:
        study = FaultStudy.read(files.faults, _MAX_BYTES, "study again")
    except InputError:
        return None
    return study if study.fingerprint == _fingerprint(inspector) else None


def keep_study(
    files: RecipeFolder, inspector: Inspector, findings: Sequence[FaultFinding]
) -> FaultStudy:
    """Write a study beside the recipe; InputError if that cannot be done."""
    study = FaultStudy(fingerprint=_fingerprint(inspector), findings=tuple(findings))
    study.write(files.faults)
    return study


def large_faults(files: RecipeFolder, inspector: Inspector) -> FaultStudy:
    """Study faults of `_LARGE_STRENGTH` size, unless a study of this recipe is kept."""
    study = kept_study(files, inspector)
    if study is None:
        findings = list(study_faults(files, inspector, _PARTS, large_only=True))
        study = keep_study(files, inspector, findings)
    return study


def require_large_faults_found(files: RecipeFolder, inspector: Inspector) -> None:
    """Check that all large faults are found, except those that the recipe acknowledges."""
    recipe = inspector.recipe
    passing = large_faults(files, inspector).passing(recipe)
    if passing:
        names = ", ".join(dict.fromkeys(f'"{finding.fault}"' for finding in passing))
        raise RecipeError(
            f"recipe {recipe.name}: passes parts with {'; '.join(map(str, passing))}; narrow its "
            f"limits, teach more parts, or set acknowledged = [{names}] in its file"
        )
