"""From four images to a match: every stage, and the whole."""

from __future__ import annotations

from functools import partial

import numpy as np

from classify import TextureLibrary
from classify.classifiers import classifier_named
from classify.texture.fields import texture_fields
from classify.texture.spectra import field_spectra
from classify.texture.statistics import levels_for, local_statistics

from .figures import Chapter, Figure
from .scenes import Shot, turned_patch
from .solvers import read_four_write_three
from .stopwatch import Work, least_ms

__all__ = ["pipeline_chapter"]

_TARGETS_MS = {512: 15.0, 1024: 60.0}
_TEXTURE, _SEED, _TURN_DEG = "sand", 1000, 33.0


def pipeline_chapter(library: TextureLibrary, size_px: int, quick: bool) -> Chapter:
    """A set of that size against a library of thirty classes."""
    shot = turned_patch(_TEXTURE, _SEED, size_px, _TURN_DEG)
    megapixels = size_px**2 / 1e6
    surface = shot.solve()
    fields = texture_fields(surface)
    joint = classifier_named(library.classifier)
    observation = joint.observe(surface, library.segment_px)
    signature = joint.signature(observation, library.parameters)
    three = np.empty((3, size_px, size_px), np.float32)
    stages: dict[str, Work] = {
        "solve, ps4_robust": shot.solve,
        "fields": partial(texture_fields, surface),
        "spectra": partial(field_spectra, fields, library.segment_px),
        "statistics": partial(local_statistics, fields, levels_for(library.segment_px)),
        "signature": partial(joint.signature, observation, library.parameters),
        "match": partial(library.match, signature),
    }
    whole: dict[str, Work] = {
        "floor": partial(read_four_write_three, shot.images, *three),
        "whole": partial(_classified, library, shot),
    }
    rounds = 20 if quick else 60
    times = least_ms(whole | stages, rounds)
    match = library.classify(surface)
    whole_ms = times["whole"]
    figures = [
        Figure("whole, images to match", whole_ms, "ms", target=_TARGETS_MS.get(size_px)),
        Figure("whole, images to match", whole_ms / times["floor"], "x floor", whole_ms),
    ]
    for stage in stages:
        ms = times[stage]
        figures += [
            Figure(stage, ms / times["floor"], "x floor", ms),
            Figure(stage, ms / megapixels, "ms per megapixel"),
        ]
    return Chapter(
        f"Classification, 16 bit, {size_px} x {size_px}, {len(library.classes)} classes",
        figures,
        (
            f"The shortest of {rounds} calls, taken in turn, warm; with an ambient frame.",
            f"{_TEXTURE} turned by {_TURN_DEG:g} degrees: {match.reason}.",
        ),
    )


def _classified(library: TextureLibrary, shot: Shot) -> None:
    library.classify(shot.solve())
