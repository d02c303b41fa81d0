"""Directions or positions of the lights as measured."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.lighting import Lighting

Source = Literal["plate", "mirror sphere", "matte sphere", "list"]


@dataclass(frozen=True, eq=False)
class CalibratedLights:
    """The N lights of a rig with their uncertainties.

    Attributes
    ----------
    lighting
        Directions seen from the middle of the frame, and positions where they are known.
    source
        What they were measured with; ``list`` for a file of directions.
    direction_errors_deg
        (N,) standard errors of the directions.
    distance_errors
        (N,) standard errors of the distances from the middle of the frame, as shares of them; None
        for distant lights.
    residual
        rms difference of the measurement from the model, as a share of its signal.
    lobe_exponent
        m of the strength of an LED at an angle to its axis, cos^m; None if not measured.

    Raises
    ------
    InputError
        For another shape, a value that is negative or not finite, or an unknown source.
    """

    lighting: Lighting
    source: Source
    direction_errors_deg: npt.NDArray[np.float64]
    distance_errors: npt.NDArray[np.float64] | None
    residual: float
    lobe_exponent: float | None

    def __post_init__(self) -> None:
        if self.source not in get_args(Source):
            raise InputError(
                f"lights from {self.source!r}; known are {', '.join(get_args(Source))}"
            )
        for name, errors in (
            ("direction errors", self.direction_errors_deg),
            ("distance errors", self.distance_errors),
        ):
            if errors is not None and (
                errors.shape != (len(self.lighting),)
                or not np.isfinite(errors).all()
                or errors.min() < 0.0
            ):
                raise InputError(
                    f"{name} are {errors.tolist()}; give one of 0 or more for each of "
                    f"{len(self.lighting)} lights"
                )
        exponent = 0.0 if self.lobe_exponent is None else self.lobe_exponent
        if not (0.0 <= self.residual < np.inf and 0.0 <= exponent < np.inf):
            raise InputError(
                f"lights with a residual of {self.residual:g} and a lobe exponent of {exponent:g}; "
                "both are 0 or more"
            )
