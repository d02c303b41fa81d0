"""Stated strengths of defects: found in 9 of 10 places of parts that were not taught."""

from dataclasses import replace

import numpy as np
import pytest

from classify import DefectModel, SurfaceEstimate, learn_defects
from classify.defects.defect_map import CELL_PX
from classify.defects.detectability import (
    MARGIN_PX,
    KnownDefect,
    Place,
    detectability,
    places_for,
    scores_at,
    stated_strength,
    threshold_strengths,
)

SIDE = 256
TEXTURE = "dyed"
SCRATCH, DENT, STAIN = (
    KnownDefect("scratch", 3.0),
    KnownDefect("dent", 24.0),
    KnownDefect("stain", 24.0),
)

Parts = list[tuple[SurfaceEstimate, float | None]]


@pytest.fixture(scope="module")
def taught(stationary) -> Parts:
    return [(stationary(TEXTURE, seed=seed, side=SIDE), None) for seed in range(12)]


@pytest.fixture(scope="module")
def model(taught: Parts) -> DefectModel:
    return learn_defects(*zip(*taught, strict=True))


@pytest.fixture(scope="module")
def stated(model: DefectModel, taught: Parts) -> dict[KnownDefect, float]:
    found = detectability(model, taught, 1.0, (SCRATCH, DENT, STAIN))
    assert all(each.strength is not None for each in found)
    return {each.defect: each.strength or 0.0 for each in found}


def groove(x: np.ndarray, y: np.ndarray, angle: float) -> np.ndarray:
    """Height of a scratch 3 px wide and 1 px deep: the formula, not the code that is tested."""
    along = np.cos(angle) * x + np.sin(angle) * y
    across = (np.cos(angle) * y - np.sin(angle) * x) / 1.5
    ends = 0.5 - 0.5 * np.cos(np.pi * np.clip((20.0 - abs(along)) / 10.0, 0.0, 1.0))
    return -ends * (1.0 - across**2) * np.exp(-0.5 * across**2)


def hollow(x: np.ndarray, y: np.ndarray, angle: float) -> np.ndarray:  # noqa: ARG001
    return -0.5 - 0.5 * np.cos(np.pi * np.minimum(np.hypot(x, y) / 12.0, 1.0))


def shares_found(
    model: DefectModel, parts: list[SurfaceEstimate], defect: KnownDefect, factor: float
) -> float:
    """Share of places where a defect of this depth is found, by differences of its height."""
    draw, found = np.random.default_rng(5), []
    height = groove if defect is SCRATCH else hollow
    for part in parts:
        rows, columns = np.indices(part.shape)
        places = places_for(part.shape, defect, draw)
        p, q = part.p.copy(), part.q.copy()
        for place in places:
            x, y = columns - place.column, place.row - rows
            step = 0.05
            for slope, right, up in ((p, step, 0.0), (q, 0.0, step)):
                ahead, behind = (
                    height(x + sign * right, y + sign * up, place.angle) for sign in (1, -1)
                )
                slope += (factor * (ahead - behind) / (2.0 * step)).astype(np.float32)
        score = model.map_of(replace(part, p=p, q=q), None).score
        found += (scores_at(score, defect, places) > 1.0).tolist()
    return float(np.mean(found))


@pytest.mark.parametrize("defect", [SCRATCH, DENT])
def test_a_defect_of_the_stated_depth_is_found_in_nine_of_ten_places(
    model: DefectModel, stated: dict[KnownDefect, float], stationary, defect: KnownDefect
) -> None:
    parts = [stationary(TEXTURE, seed=seed, side=SIDE) for seed in range(40, 52)]
    assert shares_found(model, parts, defect, 1.15 * stated[defect]) >= 0.9
    assert shares_found(model, parts, defect, 0.85 * stated[defect]) < 0.9


def test_a_stain_of_the_stated_contrast_is_just_found(
    model: DefectModel, stated: dict[KnownDefect, float], stationary
) -> None:
    part = stationary(TEXTURE, seed=60, side=SIDE)
    rows, columns = np.indices(part.shape)
    place = Place(128.0, 120.0, 0.0)
    inside = np.hypot(columns - place.column, rows - place.row) < 8.5  # about half of its fading
    scores = []
    for factor in (0.5, 1.5):
        albedo = part.albedo * np.where(inside, 1.0 - factor * stated[STAIN], 1.0)
        score = model.map_of(replace(part, albedo=albedo.astype(np.float32)), None).score
        scores += scores_at(score, STAIN, [place]).tolist()
    assert scores[0] < 1.0 < scores[1]


def test_a_higher_limit_needs_deeper_defects(
    model: DefectModel, taught: Parts, stated: dict[KnownDefect, float]
) -> None:
    (deeper,) = detectability(model, taught, 1.5, (SCRATCH,))
    assert deeper.strength is not None
    assert 1.1 * stated[SCRATCH] < deeper.strength < 3.0 * stated[SCRATCH]
    (never,) = detectability(model, taught, 1e6, (SCRATCH,))
    assert never.strength is None


def test_only_valid_places_count(model: DefectModel, taught: Parts) -> None:
    surface = taught[0][0]
    valid = np.zeros(surface.shape, np.bool_)
    valid[:40] = True
    nowhere = [(replace(surface, valid=valid), None)]
    assert detectability(model, nowhere, 1.0, (SCRATCH,)) == ()


def test_a_piece_of_a_large_part_stands_for_it(
    model: DefectModel, stated: dict[KnownDefect, float], stationary
) -> None:
    large: Parts = [(stationary(TEXTURE, seed=seed, side=640), None) for seed in range(4)]
    (found,) = detectability(model, large, 1.0, (SCRATCH,))
    assert found.strength == pytest.approx(stated[SCRATCH], rel=0.2)


def test_places_keep_from_the_border_and_from_each_other() -> None:
    places = places_for((512, 300), STAIN, np.random.default_rng(1))
    middles = np.array([(place.column, place.row) for place in places])
    assert len(places) == 4 * 2
    assert middles.min() >= MARGIN_PX + 12.0
    assert (middles <= np.array([300, 512]) - MARGIN_PX - 12.0).all()
    apart = np.linalg.norm(middles[:, None] - middles[None], axis=2)
    assert apart[~np.eye(len(places), dtype=bool)].min() >= 90.0


def test_bisection_finds_each_threshold() -> None:
    thresholds = np.array([0.1, 0.5, 2.0, 40.0])
    found = threshold_strengths(lambda strengths: (strengths / thresholds) ** 1.5, 4, 0.01, 8.0, 5)
    assert found[:3] == pytest.approx(thresholds[:3], rel=0.01)
    assert found[3] == np.inf
    steps = threshold_strengths(
        lambda strengths: 1.0 + (strengths - thresholds > 0.0), 4, 0.01, 8.0, 12
    )
    assert steps[:3] == pytest.approx(thresholds[:3], rel=0.01)
    assert stated_strength([1.0] * 9 + [np.inf]) is None
    assert stated_strength([*range(1, 11), np.inf]) == 10.0


def test_the_score_of_a_place_is_the_highest_around_it() -> None:
    score = np.zeros((32, 32), np.float32)
    score[10, 20], score[31, 31], score[9, 20] = 3.0, 9.0, np.nan
    middle = Place(20.5 * CELL_PX, 10.5 * CELL_PX, 0.0)
    assert scores_at(score, STAIN, [middle, Place(60.0, 60.0, 0.0)]).tolist() == [3.0, 0.0]
