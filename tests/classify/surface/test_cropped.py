"""A part of a solved surface."""

import numpy as np

from classify import Lighting, photometric_stereo


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
