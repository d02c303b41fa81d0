"""Types of arrays; the docstrings that name an array give its shape."""

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
BoolArray = npt.NDArray[np.bool_]
FloatMap = npt.NDArray[np.float32]  # maps of the frame, and what kernels compute from them
Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]
