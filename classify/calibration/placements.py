"""Placements of a target that calibrate a rig together."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.errors import InputError


def check_placements_differ(images: Sequence[npt.NDArray[Any]]) -> None:
    """Check that no two placements have the same pictures: their errors would count as one.

    Raises
    ------
    InputError
        If two are the same; the message counts from 1.
    """
    for (first, one), (second, other) in combinations(enumerate(images, start=1), 2):
        if np.array_equal(one, other):
            raise InputError(
                f"placements {first} and {second} are the same pictures; turn or move the target "
                "between them, or give them once"
            )
