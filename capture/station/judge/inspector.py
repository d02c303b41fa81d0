"""`Inspector`: judge the captured set of a part by a recipe; files are read only to load it."""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, Self

import numpy as np

from capture.acquisition.light_checks import known_levels, share_while_off
from capture.calibration.lookup import FoundCalibration
from capture.calibration.setting import Setting
from capture.sets.captured_set import CapturedSet
from capture.station.domain.limits import LimitedMeasures
from capture.station.domain.recipe import Orientation, Recipe
from capture.station.domain.recipe_file import RecipeFolder, file_sha256, read_recipe
from capture.station.domain.taught import (
    Taught,
    TaughtTexture,
    TextureModels,
    check_unchanged,
    models_of,
    taught_for,
)
from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.results.part_result import DefectRecord, PartResult
from classify import DefectMap, Match, TextureLibrary
from classify.base.threads import in_background
from classify.classifiers.joint import ring_means
from classify.defects.fields import part_fields
from classify.pieces.features import band_moments
from classify.surface.tilt_error import tilt_error_deg
from rig.config.lights import led_names

from .fingerprint import Fingerprint
from .judge import (
    Finding,
    Measures,
    orientation_of,
    relative_levels,
    validity_findings,
    verdict_of,
)
from .measured_surface import MeasuredSurface, fits
from .outlines import defects_of_map, defects_of_windows, in_image

_MATCH_FIELDS = ("label", "nearest", "distance", "limit", "margin", "blur_px")
_LIMITED_MEASURES = tuple(measure.name for measure in fields(LimitedMeasures))
# Largest share of an LED's light in the ambient image without a note. Sets of sound LEDs get none,
# an LED with 3 % gets one (tests/capture/station/run/test_weak_led.py).
_WARN_WHILE_OFF = 0.02
COLLECTING_REASON = "this run collects parts for teaching and judges none"


@dataclass(frozen=True, eq=False)
class Inspection:
    """Verdict on one part, and the measures that it follows from."""

    verdict: Verdict
    measures: Measures = field(default_factory=Measures)
    defect_map: DefectMap | None = None  # None if the nearest texture is not one that passes
    # First the defects of the map, largest score first, then boxes of windows. All coordinates are
    # px of the whole image.
    defects: tuple[DefectRecord, ...] = ()
    # Signal of each light as a share of its taught signal, `PartResult.led_levels`; may be empty.
    light_signal_ratios: tuple[float, ...] = ()
    timings_ms: dict[str, float] = field(default_factory=dict)
    orientation_rule: Orientation = field(default_factory=Orientation)

    def recorded(self, part: PartResult) -> PartResult:
        """Return the result of a part with the inspection; NaN and infinity become None."""
        values = {name: getattr(self.measures, name) for name in _LIMITED_MEASURES}
        if (match := self.measures.match) is not None:
            values |= {name: getattr(match, name) for name in _MATCH_FIELDS}
            orientation = orientation_of(self.orientation_rule, match)
            values["orientation_deg"], values["orientation_period_deg"] = orientation
        return replace(
            part,
            verdict=self.verdict,
            defects=self.defects,
            led_levels=tuple(map(_finite_or_none, self.light_signal_ratios)),
            timings_ms=self.timings_ms,
            notes=(*part.notes, *self._notes()),
            **{name: _finite_or_none(value) for name, value in values.items()},
        )

    def _notes(self) -> Iterator[str]:
        for name, share in self.measures.lit_while_off:
            if share > _WARN_WHILE_OFF:
                yield f"{name} stays on with all LEDs off, or other light comes from its side"


@dataclass(frozen=True, eq=False)
class _MeasuredPart:
    """A part without the levels of its LEDs, which follow from the checks of its images."""

    faults: Sequence[Finding]
    measures: Measures = field(default_factory=Measures)
    light_signals: tuple[float, ...] = ()  # of `MeasuredSurface`; empty if it was not solved
    defect_map: DefectMap | None = None
    defects: tuple[DefectRecord, ...] = ()
    timings_ms: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _StartedMeasurement:
    """Measurement of a part in a thread, while its images are checked."""

    unchecked: CapturedSet
    measured: Callable[[], _MeasuredPart]

    def has_images_of(self, captured: CapturedSet) -> bool:
        """Whether a set that has passed its checks has these images."""
        unchecked = self.unchecked
        # The lighting differs if the checks corrected the level of a weak LED.
        return (
            captured.images is unchecked.images
            and captured.ambient is unchecked.ambient
            and captured.mask is unchecked.mask
            and captured.metadata.lighting == unchecked.metadata.lighting
        )


class Inspector:
    """Judges parts by one recipe, whose files are loaded and hashed once."""

    def __init__(
        self,
        recipe: Recipe,
        taught: Taught,
        library: TextureLibrary,
        models: Mapping[str, TextureModels],
        calibration: FoundCalibration | None = None,
    ) -> None:
        self.recipe = recipe
        self._taught = taught
        self._library = library
        self._models = models
        self.calibration = calibration
        self._started: _StartedMeasurement | None = None
        self.fingerprint = Fingerprint.of(recipe, taught, calibration)

    @classmethod
    def load(cls, files: RecipeFolder, calibration: str | Path | None = None) -> Self:
        """Load a recipe file, its library and models, and the calibration of the rig."""
        return cls.of(read_recipe(files.file), files, calibration)

    @classmethod
    def of(cls, recipe: Recipe, files: RecipeFolder, calibration: str | Path | None = None) -> Self:
        """Load the library and models of a recipe that is in memory."""
        version = files.version(recipe.version)
        taught = taught_for(recipe, files)
        models = {name: models_of(version, recipe, taught, name) for name in recipe.passes}
        library = TextureLibrary.load(version.library)
        # Hashed after loading, to detect a file that is exchanged meanwhile.
        library_sha256 = file_sha256(version.library)
        check_unchanged(recipe, version.library, library_sha256, taught.library_sha256)
        return cls(recipe, taught, library, models, FoundCalibration.of_rig(calibration))

    def with_calibration(self, calibration: FoundCalibration | None) -> "Inspector":
        """Return an inspector of the same recipe for sets of another calibration."""
        return Inspector(self.recipe, self._taught, self._library, self._models, calibration)

    def has_direction(self, texture: str) -> bool:
        """Whether a texture has a direction, so that windows rotated by 90 degrees are detected."""
        return self._models[texture].pieces.has_direction

    def begin(self, unchecked: CapturedSet) -> None:
        """Start to measure images in a thread; `inspect` uses the result for the same arrays."""
        result = in_background(lambda: self._measured(unchecked), is_long=True)
        self._started = _StartedMeasurement(unchecked, result)

    def inspect(self, captured: CapturedSet) -> Inspection:
        """Judge one part; a set that cannot be judged gets the verdict ERROR.

        Exceptions are not caught here: `PartJudge` gives the verdict ERROR for them.
        """
        started = self._started
        if started is not None and started.has_images_of(captured):
            part = started.measured()
        else:
            part = self._measured(captured)
        known = known_levels(captured.metadata.checks)
        ratios = self._signal_ratios(part, known)
        measures = part.measures
        if ratios:
            names = led_names(captured.lighting.tilts_deg)
            levels = zip(names, relative_levels(ratios), strict=True)
            measures = replace(measures, led_levels=tuple(levels))
        if known is None:
            textures = self._textures_of(part.measures.match)
            least = min(texture.least_led_level for texture in textures)
            measures = replace(measures, least_led_level=least)
        return Inspection(
            verdict=verdict_of(self.recipe, measures, part.faults),
            measures=measures,
            defect_map=part.defect_map,
            defects=part.defects,
            light_signal_ratios=ratios,
            timings_ms=part.timings_ms,
            orientation_rule=self.recipe.orientation,
        )

    @property
    def _has_angle_sd_limit(self) -> bool:
        all_limits = (self.recipe.limits, *self.recipe.limits_of.values())
        return any(limits.angle_sd is not None for limits in all_limits)

    def _measured(self, captured: CapturedSet) -> _MeasuredPart:
        faults = list(self._faults(captured))
        if faults:
            return _MeasuredPart(faults)
        timings_ms: dict[str, float] = {}
        with _timed(timings_ms, "solve"):
            measured = MeasuredSurface.of(
                captured,
                self.recipe.region,
                self.calibration,
                self._library.method,
                uncertainty=self._has_angle_sd_limit,
            )
            measures = _surface_measures(captured, measured)
        if not any(validity_findings(self.recipe, measures)):
            with _timed(timings_ms, "match"):
                fields = in_background(partial(part_fields, measured.surface))
                tilt_error = in_background(partial(tilt_error_deg, measured.surface))
                moments = in_background(partial(band_moments, measured.surface))
                signature = self._library.observe(measured.surface)
                # Not `classify`, which warns if surface and library have different corrections: the
                # present calibration may have a flat field that the taught one lacked.
                measures = replace(
                    measures, match=self._library.match_surface(measured.surface, signature)
                )
        # A part with a large defect may be unknown: its defects are recorded against the nearest
        # texture.
        match = measures.match
        texture = "" if match is None else match.label or match.nearest
        defect_map: DefectMap | None = None
        defects: tuple[DefectRecord, ...] = ()
        if match is not None and texture in self._models:
            models = self._models[texture]
            with _timed(timings_ms, "defects"):
                if match.label is not None:
                    rotated = self._taught.textures[texture].tilt_faults(tilt_error())
                    faults += [Finding(Cause.CALIBRATION, fault) for fault in rotated]
                rings, orientation_deg = ring_means(signature), match.orientation_deg
                wait_for_pieces = in_background(
                    partial(models.pieces.measure, moments(), orientation_deg, rings)
                )
                defect_map = models.defects.map_of_fields(fields(), orientation_deg)
                gap_px = measured.largest_gap_px(defect_map)
                limits = self.recipe.limits_for(texture)
                outlined = list(defects_of_map(defect_map, limits.defect))
                pieces = wait_for_pieces()
                outlined += defects_of_windows(pieces, limits)
                defects = tuple(in_image(self.recipe.region, outline) for outline in outlined)
                measures = replace(
                    measures,
                    defect_score=defect_map.worst,
                    unjudged_px=gap_px,
                    octaves=pieces.octaves,
                    scale=pieces.scale,
                    handedness=pieces.handedness,
                    window=pieces.window,
                    seam=pieces.seam,
                )
        return _MeasuredPart(
            faults, measures, measured.light_signals, defect_map, defects, timings_ms
        )

    def _signal_ratios(
        self, part: _MeasuredPart, known: Sequence[float] | None
    ) -> tuple[float, ...]:
        """Signal of each light over the taught one of the texture; empty without signals.

        A part with more slopes to one side than the taught ones changes the ratios, as unequal
        LEDs do. `known` levels of the LEDs stand for the differences of the ratios.
        """
        if not part.light_signals:
            return ()
        textures = self._textures_of(part.measures.match)
        taught = np.mean([texture.light_signals for texture in textures], axis=0)
        ratios = np.array(part.light_signals) / taught
        if known is not None:
            ratios = ratios.mean() * np.array(known) / np.mean(known)
        return tuple(ratios.tolist())

    def _textures_of(self, match: Match | None) -> list[TaughtTexture]:
        """Return the texture of a match if it passes, else all textures that pass."""
        name = "" if match is None else match.label or match.nearest
        names = [name] if name in self.recipe.passes else self.recipe.passes
        return [self._taught.textures[name] for name in names]

    def _faults(self, captured: CapturedSet) -> Iterator[Finding]:
        """Yield the reasons why the set cannot be judged, whatever part it shows."""
        texts = chain(self.faults_of(captured.setting), self._calibration_faults(captured))
        yield from (Finding(Cause.CALIBRATION, text) for text in texts)

    def faults_of(self, setting: Setting) -> Iterator[str]:
        """Yield the reasons why no set of a rig with this setting can be judged."""
        for difference in self._taught.setting.all_differences(setting):
            yield f"not the setting that was taught: {difference}"
        region = self.recipe.region
        if not fits(region, (setting.height_px, setting.width_px)):
            yield f"the region {region} exceeds the image"
        if self.calibration is not None and not self._taught.has_calibration:
            yield "the recipe was taught without a calibration"
        if self.calibration is None and (
            self.recipe.calibration.required or self._taught.has_calibration
        ):
            yield "the recipe needs a calibration; give the rig one"

    def _calibration_faults(self, captured: CapturedSet) -> Iterator[str]:
        calibration_ids = captured.metadata.calibration_ids
        if self.calibration is None:
            if calibration_ids:
                yield "the set names a calibration, the station has none"
            return
        file = self.calibration.file
        if file.hash not in calibration_ids:
            yield "the set does not name the calibration of the station"
        try:
            created = datetime.fromisoformat(captured.metadata.created_utc)
        except ValueError:
            yield "the set has no date"
            return
        created = created if created.tzinfo is not None else created.replace(tzinfo=UTC)
        for name, record in file.records.items():
            fault = self.recipe.calibration.age_fault(record.age_days(created))
            if fault is not None:
                yield f"{name.replace('_', ' ')} {fault}"


def _surface_measures(captured: CapturedSet, measured: MeasuredSurface) -> Measures:
    """Return the measures that need no texture."""
    return Measures(
        unmeasured_fraction=measured.unmeasured_fraction,
        saturated_fraction=measured.share(measured.saturated),
        lit_while_off=_lit_while_off(captured),
        sdq=measured.sdq,
        shadow_fraction=measured.share(measured.shadowed),
        albedo=measured.albedo,
        angle_sd=measured.angle_sd,
    )


def _lit_while_off(captured: CapturedSet) -> tuple[tuple[str, float], ...]:
    if captured.ambient is None:
        return ()
    shares = share_while_off(captured.images, captured.ambient)
    return tuple(zip(led_names(captured.lighting.tilts_deg), shares.tolist(), strict=True))


def _finite_or_none(value: Any) -> Any:
    """A value; None for NaN and infinity, which the results cannot store."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def _timed(timings_ms: dict[str, float], step: str) -> Iterator[None]:
    started_s = time.perf_counter()
    yield
    timings_ms[step] = 1000.0 * (time.perf_counter() - started_s)


class Collector:
    """Stands in for an inspector while parts are collected for teaching: all are UNKNOWN."""

    def __init__(self, recipe: Recipe, calibration: FoundCalibration | None = None) -> None:
        self.recipe, self.calibration = recipe, calibration

    def faults_of(self, setting: Setting) -> Iterator[str]:  # noqa: ARG002 - as an inspector
        """Yield nothing: sets of any setting can be collected."""
        yield from ()

    def begin(self, unchecked: CapturedSet) -> None:
        """Do nothing: no part is judged."""

    def inspect(self, captured: CapturedSet) -> Inspection:  # noqa: ARG002 - as an inspector
        """Judge nothing."""
        return Inspection(Verdict(Decision.UNKNOWN, COLLECTING_REASON, (Cause.COLLECTED,)))
