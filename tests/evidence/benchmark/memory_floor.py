"""The memory traffic of a solver without its arithmetic: a bound on its time."""

from typing import Any

import numpy as np
import numpy.typing as npt

from classify.base.compiling import kernel
from classify.base.threads import run_on_rows


def read_four_write_three(images: npt.NDArray[Any], maps: npt.NDArray[np.float32]) -> None:
    """Read four images, write three maps: differences of opposite images, and the sum.

    Parameters
    ----------
    images
        (4, H, W) of any type.
    maps
        (3, H, W) float32, overwritten.
    """
    run_on_rows(lambda first, last: _rows(images, maps, first, last), maps.shape[1:])


@kernel
def _rows(images: npt.NDArray[Any], maps: npt.NDArray[np.float32], first: int, last: int) -> None:
    for r in range(first, last):
        for c in range(maps.shape[2]):
            v0, v1 = np.float32(images[0, r, c]), np.float32(images[1, r, c])
            v2, v3 = np.float32(images[2, r, c]), np.float32(images[3, r, c])
            maps[0, r, c] = v0 - v2
            maps[1, r, c] = v1 - v3
            maps[2, r, c] = v0 + v1 + v2 + v3
