"""Teach the defect map of a texture: model, detection limits, and a mark on all good parts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from capture.base.console import ShowProgress
from capture.station.domain.recipe import Recipe, Region
from capture.station.domain.taught import DetectionLimit
from classify import DefectModel, SurfaceEstimate, TextureLibrary, learn_defects
from classify.classifiers import classifier_named
from classify.defects.detectability import detectability
from classify.defects.learning import FixedMarks

from .taught_parts import TaughtPart, solved


@dataclass(frozen=True, eq=False)
class TaughtDefects:
    """The defect model of one texture, with its detection limits and a mark on all good parts."""

    model: DefectModel
    least_found: tuple[DetectionLimit, ...]
    mark: Region | None  # in the whole image


def teach_defects(
    good: Sequence[TaughtPart], library: TextureLibrary, recipe: Recipe, show: ShowProgress
) -> TaughtDefects:
    """Learn the defect model of one texture from its good parts."""
    classifier, texture = classifier_named(library.classifier), good[0].kept_set.texture
    orientations_deg = [
        library.match(
            classifier.signature(part.matching_observation, library.parameters)
        ).orientation_deg
        for part in good
    ]
    marks = FixedMarks()

    def surface_of(part: TaughtPart) -> SurfaceEstimate:
        return solved(part.kept_set, recipe.region)[1].surface

    def surfaces() -> Iterator[SurfaceEstimate]:
        for part in show(good, len(good), f"defects of {texture}"):
            surface = surface_of(part)
            marks.add(surface)
            yield surface

    model = learn_defects(surfaces(), orientations_deg)
    # In random order, so that the first parts are spread over the whole time of the captures.
    order = np.random.default_rng(0).permutation(len(good)).tolist()
    surfaces_to_try = ((surface_of(good[n]), orientations_deg[n]) for n in order)
    limit = recipe.limits_for(texture).defect or 1.0
    least_found = (
        DetectionLimit(
            kind=result.defect.kind,
            size_px=result.defect.size_px,
            strength=result.strength,
            strongest=result.defect.strongest,
            mm_per_px=good[0].mm_per_px,
        )
        for result in show(
            detectability(model, surfaces_to_try, limit), 1, f"what is found on {texture}"
        )
    )
    return TaughtDefects(model, tuple(least_found), _in_image(marks.strongest(), recipe.region))


def mark_remark(texture: str, parts: int, mark: Region) -> str:
    """Return a remark on a mark that all parts have, with advice."""
    return (
        f"{texture}: all {parts} good parts look alike in {mark}, and nowhere else: a printed logo "
        "or a stamped mark is no texture, and defects on it are not found. Set [region] to leave "
        "it out, and teach again"
    )


def _in_image(box: tuple[int, int, int, int] | None, region: Region | None) -> Region | None:
    if box is None:
        return None
    x, y, width, height = box
    left, top = (0, 0) if region is None else (region.x, region.y)
    # A region has 16 px or more.
    return Region(x=left + x, y=top + y, width=max(width, 16), height=max(height, 16))
