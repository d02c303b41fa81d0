"""Errors of the tilts that good parts show, whatever their orientation."""

import numpy as np
import pytest

from classify.surface.tilt_error import tilt_error_deg
from tests.capture.station.teaching_sets import patch


@pytest.mark.slow
@pytest.mark.parametrize(
    ("surface", "most_deg"), [("rock", 0.1), ("Leather037", 0.5), ("brushed", 2.0)]
)
def test_parts_of_any_orientation_differ_by_less_than_the_margin(
    surface: str, most_deg: float
) -> None:
    parts = (patch(surface, number, 512) for number in range(8))
    errors_deg = [tilt_error_deg(part.solve(planar=True)) for part in parts]
    assert np.abs(errors_deg).max() < most_deg
