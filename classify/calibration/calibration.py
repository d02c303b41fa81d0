"""`Calibration`: everything that is known of one rig at one setting."""

from dataclasses import dataclass

from classify.lights.flat_field import FlatField

from .dark import Dark
from .lights import CalibratedLights
from .noise import Noise
from .response import Response
from .scale import Scale


@dataclass(frozen=True, eq=False)
class Calibration:
    """The measured parts of a calibration; a part that was not measured is None."""

    dark: Dark | None = None
    response: Response | None = None
    noise: Noise | None = None
    flat_field: FlatField | None = None
    lights: CalibratedLights | None = None
    scale: Scale | None = None
