"""Errors of the tilts that good parts show, whatever their orientation."""

import numpy as np
import pytest

from classify.surface.tilt_error import tilt_error_deg
from tests.capture.station.teaching_sets import patch


@pytest.mark.slow
@pytest.mark.parametrize(
    ("surface", "most_deg"), [("rock", 0.05), ("Leather037", 0.5), ("brushed", 2.0)]
)
def test_the_scatter_of_parts_is_far_below_the_margin(surface: str, most_deg: float) -> None:
    parts = (patch(surface, number, 512) for number in range(8))
    errors_deg = [tilt_error_deg(part.solve(planar=True)) for part in parts]
    assert np.std(errors_deg) < most_deg
