"""All parts of one texture, scored by all detectors."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from capture.chapter.plan import Texture
from classify import TextureLibrary
from classify.defects.fields import part_fields
from rig.config.simulation import RELIEF_KINDS, DefectKind
from rig.scene.surfaces import rms_slope

from .bound import Bound, MatchedFilters
from .detectors import DETECTORS, Score
from .examples import Example
from .parts import Part, part_of
from .plan import FALSE_ALARM_RATE, STAIN, DefectCase, DefectPlan
from .scores import aupro, auroc

# Pixels between those of the pixel metrics: a quarter of the narrowest defect.
_EVERY_PX = 2


@dataclass(frozen=True)
class System:
    """A detector, and the number of good parts that it was taught."""

    detector: str
    taught: int


@dataclass(frozen=True, eq=False)
class Measured:
    """Scores of one detector on the parts of one texture; 1.0 is its limit.

    Attributes
    ----------
    good
        Highest score of each good part.
    defective
        Highest score of the part with each defect.
    pixel_auroc, aupro
        Of each kind of defect: its pixels against all pixels without a defect.
    """

    good: npt.NDArray[np.float64]
    defective: Mapping[DefectCase, float]
    pixel_auroc: Mapping[DefectKind, float]
    aupro: Mapping[DefectKind, float]

    def of_kinds(self, kinds: Collection[DefectKind]) -> npt.NDArray[np.float64]:
        """Highest scores of the parts with these defects."""
        return np.array([score for case, score in self.defective.items() if case.kind in kinds])


@dataclass(frozen=True, eq=False)
class TextureResult:
    """What was measured on one texture; `rms_slope` is that of its relief."""

    texture: str
    synthetic: bool
    rms_slope: float
    measured: Mapping[System, Measured]
    bounds: Mapping[DefectCase, Bound]  # of scratches, dents, bumps and stains
    example: Example | None


def measure(task: tuple[DefectPlan, int]) -> TextureResult:
    """Measure one texture of a plan, by its place in the plan."""
    plan, place = task
    texture, foreign = (plan.textures[n % len(plan.textures)] for n in (place, place + 1))
    taught = [part_of(texture, "taught", index) for index in range(max(plan.taught))]
    library = TextureLibrary.train([(texture.name, taught[0].surface)])
    angles = [orientation_deg(library, part) for part in taught]
    scores: dict[System, Score] = {
        System(name, count): learn(taught[:count], angles[:count], FALSE_ALARM_RATE)
        for name, learn in DETECTORS.items()
        for count in plan.taught
    }
    collected = {system: _Collected() for system in scores}
    good = [tested_part(texture, foreign, index, None) for index in range(plan.good)]
    filters = MatchedFilters(
        [(part_fields(part.surface), angle) for part, angle in zip(taught, angles, strict=True)],
        [(part_fields(part.surface), orientation_deg(library, part)) for part in good],
    )
    bounds: dict[DefectCase, Bound] = {}
    cases: list[DefectCase | None] = [*[None] * plan.good, *plan.cases]
    example = None
    for index, case in enumerate(cases):
        part = good[index] if case is None else tested_part(texture, foreign, index, case)
        angle = orientation_deg(library, part)
        maps = {system: score(part, angle) for system, score in scores.items()}
        for system, each in maps.items():
            collected[system].add(case, part, each)
        if case is not None and case.kind in (*RELIEF_KINDS, *STAIN):
            bounds[case] = filters.bound(case, part, angle)
        if case is not None and case == plan.examples.get(place):
            best = {s.detector: each for s, each in maps.items() if s.taught == max(plan.taught)}
            example = Example(texture.name, str(case), part.images.images[0], part.mask, best)
    slopes = [rms_slope(part.surface.p, part.surface.q) for part in taught]
    return TextureResult(
        texture.name,
        texture.folder is None,
        float(np.median(slopes)),
        {system: each.measured() for system, each in collected.items()},
        bounds,
        example,
    )


def tested_part(texture: Texture, foreign: Texture, index: int, case: DefectCase | None) -> Part:
    """A part that was not taught, good or with a defect."""
    other = foreign if case is not None and case.kind == "foreign" else None
    return part_of(texture, "tested", index, case, other)


def orientation_deg(library: TextureLibrary, part: Part) -> float:
    """Orientation as a station finds it, from the match."""
    return library.classify(part.surface).orientation_deg or 0.0


class _Collected:
    """Scores of one detector, part by part."""

    def __init__(self) -> None:
        self._good: list[float] = []
        self._defective: dict[DefectCase, float] = {}
        self._outside: list[npt.NDArray[np.float32]] = []
        self._regions: dict[DefectKind, list[npt.NDArray[np.float32]]] = {}

    def add(self, case: DefectCase | None, part: Part, score: npt.NDArray[np.float32]) -> None:
        # A cell without a score is no alarm.
        cells = np.nan_to_num(score, nan=0.0)
        worst = float(cells.max())
        pixels = cv2.resize(cells, part.mask.shape[::-1], interpolation=cv2.INTER_LINEAR)
        grid = (slice(None, None, _EVERY_PX), slice(None, None, _EVERY_PX))
        pixels, mask = np.asarray(pixels, np.float32)[grid], part.mask[grid]
        self._outside.append(pixels[~mask])
        if case is None:
            self._good.append(worst)
        else:
            self._defective[case] = worst
            self._regions.setdefault(case.kind, []).append(pixels[mask])

    def measured(self) -> Measured:
        outside = np.sort(np.concatenate(self._outside))
        return Measured(
            np.array(self._good),
            self._defective,
            {
                kind: auroc(np.concatenate(regions), outside)
                for kind, regions in self._regions.items()
            },
            {kind: aupro(regions, outside) for kind, regions in self._regions.items()},
        )
