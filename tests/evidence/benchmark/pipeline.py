"""Time of a classification from four images to a match, and of each stage."""

import time
from contextlib import suppress
from functools import partial

import numpy as np

from capture.chapter.results import Work, shortest_ms
from classify import Method, TextureLibrary
from classify.classifiers import classifier_named
from classify.texture.fields import texture_fields
from classify.texture.spectra import field_spectra
from classify.texture.statistics import levels_for, local_statistics
from tests.evidence.benchmark.memory_floor import read_four_write_three

from .measurements import Measurement, Section
from .scenes import rotated_patch
from .solvers import drop_darkest, normal_least_squares

# Targets of the project on two cores, by step and side of the frame.
_WHOLE = "whole, images to match"
_TARGETS_MS = {(_WHOLE, 512): 6.0, (_WHOLE, 1024): 18.0}
# Largest time that a planar part costs beyond another, at 512 px.
_PLANAR_MS = 0.5
_TEXTURE, _SEED, _ROTATE_DEG = "sand", 1000, 33.0
_METHODS: tuple[Method, ...] = ("ps4_robust", "least_squares")


def pipeline_section(library: TextureLibrary, size_px: int, rounds: int) -> Section:
    """Time the classification of a set of side `size_px` by the joint classifier."""
    image_set = rotated_patch(_TEXTURE, _SEED, size_px, _ROTATE_DEG)
    images, lighting = image_set.images, image_set.lighting
    solve = partial(image_set.solve, planar=library.planar)
    surface = solve()
    fields = texture_fields(surface)
    joint = classifier_named(library.classifier)
    observation = joint.observe(surface, library.segment_px)
    signature = joint.signature(observation, library.parameters)
    maps = np.empty((3, size_px, size_px), np.float32)
    steps: dict[str, Work] = {
        "floor: read 4 planes, write 3 float32": partial(read_four_write_three, images, maps),
        _WHOLE: lambda: library.classify(solve()),
        **{
            f"solve, {method}{', planar' * planar}": partial(image_set.solve, method, planar=planar)
            for method in _METHODS
            for planar in (True, False)
        },
        "spectra": partial(field_spectra, fields, library.segment_px),
        "statistics": partial(local_statistics, fields, levels_for(library.segment_px)),
        "fields": partial(texture_fields, surface),
        "signature": partial(joint.signature, observation, library.parameters),
        "match": partial(library.match, signature),
    }
    peers: dict[str, Work] = {
        "numpy lstsq": partial(normal_least_squares, images, lighting),
        "numpy drop-darkest": partial(drop_darkest, images, lighting),
    }
    with suppress(ImportError):
        from .peer import patterns, training_patterns

        taught = training_patterns(fields, len(library.classes))
        peers["scikit-image: local binary patterns, match"] = partial(patterns, fields, taught)
    times = shortest_ms(steps, rounds) | shortest_ms(peers, 3)
    processor_ms = shortest_ms({_WHOLE: steps[_WHOLE]}, rounds, time.process_time)[_WHOLE]
    floor = next(iter(times.values()))
    found = [
        Measurement(step, ms, "ms", target=_TARGETS_MS.get((step, size_px)))
        for step, ms in times.items()
    ]
    found += [
        Measurement(
            f"{method}, planar beyond not planar",
            times[f"solve, {method}, planar"] - times[f"solve, {method}"],
            "ms",
            target=_PLANAR_MS if size_px == 512 else None,
        )
        for method in _METHODS
    ]
    found += [
        Measurement(_WHOLE, times[_WHOLE] / floor, "x floor"),
        Measurement(f"{_WHOLE}, on all cores together", processor_ms, "ms"),
    ]
    return Section(
        f"Classification, 16 bit, {size_px} x {size_px}, {len(library.classes)} classes",
        found,
        (
            f"The shortest of {rounds} calls after a first one; with an ambient image.",
            f"{_TEXTURE} at {_ROTATE_DEG:g} degrees: {library.classify(surface).reason}.",
        ),
    )
