"""Time of a classification from four images to a match, and of each stage."""

from functools import partial

import numpy as np

from capture.chapter.results import Work, shortest_ms
from classify import TextureLibrary
from classify.classifiers import classifier_named
from classify.texture.fields import texture_fields
from classify.texture.spectra import field_spectra
from classify.texture.statistics import levels_for, local_statistics
from tests.evidence.benchmark.memory_floor import read_four_write_three

from .measurements import Measurement, Section
from .scenes import rotated_patch

# Targets of the project on two cores, by side of the frame.
_TARGETS_MS = {512: 15.0, 1024: 60.0}
_TEXTURE, _SEED, _ROTATE_DEG = "sand", 1000, 33.0


def pipeline_section(library: TextureLibrary, size_px: int, rounds: int) -> Section:
    """Time the classification of a set of side `size_px` by the joint classifier."""
    image_set = rotated_patch(_TEXTURE, _SEED, size_px, _ROTATE_DEG)
    solve = partial(image_set.solve, planar=library.planar)
    surface = solve()
    fields = texture_fields(surface)
    joint = classifier_named(library.classifier)
    observation = joint.observe(surface, library.segment_px)
    signature = joint.signature(observation, library.parameters)
    maps = np.empty((3, size_px, size_px), np.float32)
    stages: dict[str, Work] = {
        "solve, ps4_robust": solve,
        "fields": partial(texture_fields, surface),
        "spectra": partial(field_spectra, fields, library.segment_px),
        "statistics": partial(local_statistics, fields, levels_for(library.segment_px)),
        "signature": partial(joint.signature, observation, library.parameters),
        "match": partial(library.match, signature),
    }
    floor_and_whole: dict[str, Work] = {
        "floor": partial(read_four_write_three, image_set.images, maps),
        "whole": lambda: library.classify(solve()),
    }
    times = shortest_ms(floor_and_whole | stages, rounds)
    floor, total = times["floor"], times["whole"]
    step = "whole, images to match"
    found = [
        Measurement(step, total, "ms", target=_TARGETS_MS.get(size_px)),
        Measurement(step, total / floor, "x floor", total),
    ]
    for stage in stages:
        ms = times[stage]
        found += [
            Measurement(stage, ms / floor, "x floor", ms),
            Measurement(stage, ms / (size_px**2 / 1e6), "ms per megapixel"),
        ]
    return Section(
        f"Classification, 16 bit, {size_px} x {size_px}, {len(library.classes)} classes",
        found,
        (
            f"The shortest of {rounds} calls after a first one; with an ambient image.",
            f"{_TEXTURE} at {_ROTATE_DEG:g} degrees: {library.classify(surface).reason}.",
        ),
    )
