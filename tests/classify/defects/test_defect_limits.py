"""Limits of the defect map from few tiles."""

import numpy as np
import pytest

from classify import InputError
from classify.defects.learning import common_limit, limits_of


@pytest.mark.parametrize("valid", [0, 1])
def test_parts_that_show_less_than_two_tiles_are_refused(valid: int) -> None:
    maxima = np.full((3, 4, 5), -np.inf)
    maxima[0, :, :valid] = 0.5
    with pytest.raises(InputError, match=f"{valid} areas .* 64 x 64 px"):
        limits_of(maxima, 0.01)
    with pytest.raises(InputError, match="lit evenly"):
        common_limit(maxima[:, 0], 0.01)


def test_two_tiles_give_a_limit() -> None:
    maxima = np.full((3, 2, 5), -np.inf)
    maxima[0, :, :2] = 0.5, 0.7
    assert np.isfinite(limits_of(maxima, 0.01)).all()
