"""A mark that all good parts have at one place of the frame, and good parts without one."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from capture import capture_set
from classify import SurfaceEstimate
from classify.defects.learning import Box, FixedMarks
from rig import RigConfig, open_rig
from rig.simulation.scenes import surface_names
from tests.capture.station.teaching_sets import patch

SIDE = 256
MIDDLE = (150, 90)  # row and column


def mark_of(parts: Iterable[SurfaceEstimate]) -> Box | None:
    marks = FixedMarks()
    for part in parts:
        marks.add(part)
    return marks.strongest()


def distances() -> np.ndarray:
    rows, columns = np.indices((SIDE, SIDE))
    return np.hypot(rows - MIDDLE[0], columns - MIDDLE[1])


def stamped(surface: SurfaceEstimate) -> SurfaceEstimate:
    """A ring of 40 px, 3 px deep."""
    down, right = np.gradient(-3.0 * np.exp(-0.5 * ((distances() - 20.0) / 2.0) ** 2))
    p, q = surface.p + right, surface.q - down
    return replace(surface, p=p.astype(np.float32), q=q.astype(np.float32))


def printed(surface: SurfaceEstimate) -> SurfaceEstimate:
    albedo = np.where(distances() < 20.0, 0.5, 1.0) * surface.albedo
    return replace(surface, albedo=albedo.astype(np.float32))


@pytest.mark.parametrize("change", [stamped, printed])
def test_a_mark_on_all_parts_is_found_where_it_is(stationary, change) -> None:
    parts = [stationary("dyed", seed=seed, side=SIDE) for seed in range(8)]
    assert mark_of(parts) is None
    found = mark_of(map(change, parts))
    assert found is not None
    left, top, width, height = found
    assert left <= MIDDLE[1] <= left + width
    assert top <= MIDDLE[0] <= top + height
    assert max(width, height) <= 96


def test_a_mark_on_some_parts_is_none_of_all(stationary) -> None:
    parts = [stationary("dyed", seed=seed, side=SIDE) for seed in range(8)]
    assert mark_of([stamped(parts[0]), *parts[1:]]) is None


def test_captures_of_one_part_are_alike_everywhere(stationary) -> None:
    assert mark_of([stationary("dyed", side=SIDE)] * 8) is None


def test_a_backdrop_is_no_mark(stationary) -> None:
    valid = distances() < 80.0
    parts = [
        replace(stationary("dyed", seed=seed, side=SIDE), valid=valid, mask=valid)
        for seed in range(8)
    ]
    assert mark_of(parts) is None
    assert mark_of(map(printed, parts)) is not None
    assert mark_of([]) is None


@pytest.mark.slow
@pytest.mark.parametrize("texture", surface_names()[::3])
def test_no_texture_without_a_mark_has_one(texture: str) -> None:
    parts = [patch(texture, number).solve(planar=True) for number in range(6)]
    assert mark_of(parts) is None
    # At 1 in 8 of the texture's contrast and more.
    assert mark_of(map(printed, map(stamped, parts))) is not None


@pytest.mark.slow
def test_near_lights_and_vignetting_make_no_mark() -> None:
    uneven = {"led_distance_px": 5.0 * SIDE, "vignetting_percent": 20.0}
    parts = []
    for seed in range(6):
        placed = {"surface": "rock", "seed": seed, "shift_px": (61.0 * seed, 0.0)}
        config = RigConfig().with_changes(
            camera={"width_px": SIDE, "height_px": SIDE},
            simulation=uneven | {"placement": placed},
        )
        with open_rig(config) as rig:
            parts.append(capture_set(rig).solve(planar=True))
    assert mark_of(parts) is None
