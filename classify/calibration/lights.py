"""Directions or positions of the lights as measured."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from classify.base.arrays import Floats
from classify.base.errors import InputError
from classify.lighting import Lighting

_Source = Literal["plate", "mirror sphere", "matte sphere", "list"]


@dataclass(frozen=True, eq=False)
class CalibratedLights:
    """The N lights of a rig with their uncertainties."""

    lighting: Lighting  # directions from the middle of the frame; positions where known
    source: _Source  # what they were measured with; "list" for a file of directions
    direction_errors_deg: Floats  # (N,) standard errors
    distance_errors: Floats | None  # (N,) relative; None for distant lights
    residual: float  # rms misfit of the model, as a share of the signal
    lobe_exponent: float | None  # m of the strength cos^m at an angle to an LED's axis

    def __post_init__(self) -> None:
        if self.source not in get_args(_Source):
            raise InputError(
                f"lights from {self.source!r}; known are {', '.join(get_args(_Source))}"
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
