"""The fault plan of a simulated rig."""

from typing import Literal

from pydantic import Field, FiniteFloat

from classify.base.models import Section
from firmware_sim.faults import LedFault, LineFault, When

MAX_FRAMES_BACK = 4
"""Number of the simulated driver's buffers; a torn frame shows the old content of one."""


class FrameFault(Section):
    """A fault in frames."""

    kind: Literal[
        "dropped", "repeated_pixels", "repeated_frame", "torn", "black", "dark", "late",
        "stamped_late", "drift", "gone",
    ] = Field(
        description="repeated_pixels: with a new number and times; torn: rows of an earlier frame; "
        "black: all zero; dark: without light; drift: of the exposure; gone: no frame from then on"
    )  # fmt: skip
    row_share: float = Field(
        default=0.5,
        gt=0.0,
        lt=1.0,
        description="of a torn frame: where the earlier frame begins",
    )
    frames_back: int = Field(
        default=1, ge=1, le=MAX_FRAMES_BACK, description="of a torn frame, 1 to 4"
    )
    delay_ms: float = Field(
        default=10.0, ge=0.0, le=60_000.0, description="of late and stamped_late"
    )
    rate_per_s: FiniteFloat = Field(
        default=0.5, description="of drift: share of the exposure per second"
    )
    when: When = Field(default=When(), description="as of a line")


class FaultPlan(Section):
    """Faults of a simulated rig, injected below the drivers.

    Attributes
    ----------
    seed
        Of all random faults.
    lines
        Of the serial line.
    leds
        In the light of the LEDs.
    frames
        In the camera's frames.
    """

    seed: int = Field(default=1, ge=0, lt=2**63)
    lines: tuple[LineFault, ...] = Field(default=(), strict=False)
    leds: tuple[LedFault, ...] = Field(default=(), strict=False)
    frames: tuple[FrameFault, ...] = Field(default=(), strict=False)
