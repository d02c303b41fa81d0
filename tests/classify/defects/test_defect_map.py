"""Regions of a defect map: boxes, kinds, areas and outlines of connected cells."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from classify import DefectMap, regions_of

SHAPE = (61, 83)  # the last cells are cut by the frame
CELLS = (8, 11)
SCORES = arrays.arrays(
    np.float32, CELLS, elements=st.sampled_from([0.0, 0.5, 1.0, 1.5, 3.0, np.nan])
)


@given(SCORES, SCORES)
def test_regions_hold_every_cell_above_the_limit_once(relief, albedo) -> None:
    texture = np.full(CELLS, 0.2, np.float32)
    score = np.maximum(np.maximum(relief, albedo), texture)
    found = DefectMap(relief, albedo, texture, score, SHAPE)
    regions = regions_of(found)
    with np.errstate(invalid="ignore"):
        above = found.score > 1.0
    assert sum(region.area_px for region in regions) == 64 * np.count_nonzero(above)
    assert [r.score for r in regions] == sorted((r.score for r in regions), reverse=True)
    for region in regions:
        x, y, width, height = region.box
        assert x + width <= SHAPE[1]
        assert y + height <= SHAPE[0]
        cells = np.s_[y // 8 : -(-(y + height) // 8), x // 8 : -(-(x + width) // 8)]
        assert region.score in getattr(found, region.kind)[cells]
        np.testing.assert_array_equal(region.outline.min(axis=0), [x, y])
        np.testing.assert_array_equal(region.outline.max(axis=0), [x + width - 1, y + height - 1])


def test_a_map_without_a_score_has_no_worst_and_no_region() -> None:
    nothing = np.full(CELLS, np.nan, np.float32)
    found = DefectMap(nothing, nothing, nothing, nothing, SHAPE)
    assert np.isnan(found.worst)
    assert regions_of(found) == ()
