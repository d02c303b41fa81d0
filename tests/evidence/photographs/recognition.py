"""Recognition of photographed objects, with and without the object among those taught."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

from capture.base.console import progress
from classify import Match, SurfaceEstimate, TextureLibrary, Trial
from classify.library.training import TrainingRow, observe
from classify.texture.spectra import segment_for

from .photograph_set import PhotographSet, Pick
from .scores import solve_pick

PATCH_PX = 256
"""Side of the patches; objects with a shorter side are left out."""

# Libraries of one half of the objects each. There are 252 for ten objects, and 30 of them give the
# share of accepted tests to one or two percent.
_MOST_HALVES = 30


@dataclass(frozen=True, eq=False)
class TestPatch:
    """One patch of an object; `kind` says how it differs from the taught one."""

    name: str
    kind: str
    surface: SurfaceEstimate


@dataclass(frozen=True)
class Recognition:
    """What a test patch is taken for.

    Attributes
    ----------
    trial
        The match where all objects are taught.
    kind
        How the patch differs from the taught one.
    unknown
        Matches with libraries of half of the objects, its own not among them.
    """

    trial: Trial
    kind: str
    unknown: tuple[Match, ...]


def recognitions(sets: Sequence[PhotographSet]) -> list[Recognition]:
    """Teach each object by one patch, and match patches of all objects.

    The patch at the upper left under the first pick of lights is taught. Empty if fewer than two
    objects are large enough.
    """
    large = [each for each in sets if min(each.mask.shape) >= PATCH_PX]
    if len(large) < 2:
        return []
    segment_px = segment_for((PATCH_PX, PATCH_PX))
    rows = {
        each.name: TrainingRow(
            each.name, observe(_solved(each.patch(0, 0, PATCH_PX), each.picks()[0]), segment_px)
        )
        for each in large
    }
    tests = [patch for each in large for patch in test_patches(each)]
    everything = tuple(rows)
    trials: list[Trial] = []
    unknown: list[list[Match]] = [[] for _ in tests]
    choices = [everything, *_halves(everything)]
    for taught in progress(choices, len(choices), "match"):
        library = TextureLibrary.from_observations([rows[name] for name in taught], segment_px)
        for test, matches in zip(tests, unknown, strict=True):
            if taught == everything:
                trials.append(Trial(test.name, None, library.match_surface(test.surface)))
            elif test.name not in taught:
                matches.append(library.match_surface(test.surface))
    return [
        Recognition(trial, test.kind, tuple(matches))
        for trial, test, matches in zip(trials, tests, unknown, strict=True)
    ]


def test_patches(photographs: PhotographSet) -> Iterator[TestPatch]:
    """The taught patch rotated and under other lights, and the patches at the other corners."""
    name, (taught, *others) = photographs.name, photographs.picks()
    corner = photographs.patch(0, 0, PATCH_PX)
    rotated = corner
    for _ in range(3):
        rotated = rotated.rotated()
        yield TestPatch(name, "rotated by quarter turns", _solved(rotated, taught))
    rows, columns = (length - PATCH_PX for length in photographs.mask.shape)
    for top, left in sorted({(0, columns), (rows, 0), (rows, columns)} - {(0, 0)}):
        patch = photographs.patch(top, left, PATCH_PX)
        yield TestPatch(name, "another corner", _solved(patch, taught))
    for pick in others:
        yield TestPatch(name, "other lights", _solved(corner, pick))


def _solved(photographs: PhotographSet, pick: Pick) -> SurfaceEstimate:
    """Solve as `ps4rig classify` does for photographs that were imported with a mask."""
    surface = solve_pick(photographs, pick, "ps4_robust", planar=True)
    return replace(surface, valid=surface.valid & photographs.mask)


def _halves(names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Every choice of half of the names, or `_MOST_HALVES` random ones."""
    half = len(names) // 2
    if comb(len(names), half) <= _MOST_HALVES:
        return list(combinations(names, half))
    draw = random.Random(0)
    return [tuple(draw.sample(names, half)) for _ in range(_MOST_HALVES)]
