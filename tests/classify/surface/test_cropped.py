"""A part of a solved surface."""

import numpy as np
import pytest

from classify import Lighting, photometric_stereo
from classify.surface.estimate import inscribed_square


def test_a_part_has_the_slopes_and_shadows_of_the_whole() -> None:
    draw = np.random.default_rng(6)
    images = draw.integers(200, 4000, (4, 40, 60)).astype(np.uint16)
    whole = photometric_stereo(images, Lighting.ring(45.0), full_scale=4095)
    rows, columns = slice(5, 25), slice(10, 50)
    part = whole.cropped(rows, columns)
    assert part.shape == (20, 40)
    for name in ("p", "q", "albedo", "valid", "shadow_count", "specular", "dropped"):
        found = getattr(part, name)
        assert np.array_equal(found, getattr(whole, name)[rows, columns]), name
        assert found.flags.c_contiguous
    assert part.shadow_mask.any()
    assert part.images is None


@pytest.mark.parametrize("side", [1, 2, 7, 8])
def test_the_largest_square_within_a_mask_is_found(side: int) -> None:
    mask = np.zeros((20, 30), np.bool_)
    mask[3, :] = mask[:, 29] = True
    mask[8 : 8 + side, 21 : 21 + side] = True
    rows, columns = inscribed_square(mask)
    assert mask[rows, columns].all()
    assert mask[rows, columns].shape == (side, side)


@pytest.mark.parametrize(("rows", "columns", "side"), [(64, 64, 64), (1, 5, 1), (5, 2, 2)])
def test_a_mask_of_the_whole_frame_leaves_its_first_square(
    rows: int, columns: int, side: int
) -> None:
    whole = np.ones((rows, columns), np.bool_)
    assert inscribed_square(whole) == (slice(0, side), slice(0, side))
