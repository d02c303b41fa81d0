"""The fault plan of a simulated rig."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from firmware_sim.faults import LedFault, LineFault, When, require

MAX_FRAMES_BACK = 4
"""Number of the simulated driver's buffers; a torn frame shows the old content of one."""


@dataclass(frozen=True)
class FrameFault:
    """A fault in frames."""

    kind: Annotated[
        Literal[
            "dropped", "repeated_pixels", "repeated_frame", "torn", "black", "dark", "late",
            "stamped_late", "drift", "gone",
        ],
        "repeated_pixels: with a new number and times; torn: rows of an earlier frame; black: all "
        "zero; dark: without light; drift: of the exposure; gone: no frame from then on",
    ]  # fmt: skip
    row_share: Annotated[float, "of a torn frame: where the earlier frame begins"] = 0.5
    frames_back: Annotated[int, "of a torn frame, 1 to 4"] = 1
    delay_ms: Annotated[float, "of late and stamped_late"] = 10.0
    rate_per_s: Annotated[float, "of drift: share of the exposure per second"] = 0.5
    when: Annotated[When, "as of a line"] = field(default_factory=When)

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - unknown keys are refused

    def __post_init__(self) -> None:
        back = self.frames_back
        require(
            0.0 < self.row_share < 1.0,
            f"row_share is {self.row_share:g}; give more than 0, less than 1",
        )
        require(1 <= back <= MAX_FRAMES_BACK, f"frames_back is {back}; give 1 to {MAX_FRAMES_BACK}")
        require(0.0 <= self.delay_ms <= 60_000.0, f"delay_ms is {self.delay_ms:g}; give 0 to 60000")
        require(math.isfinite(self.rate_per_s), f"rate_per_s is {self.rate_per_s:g}; give a number")


class FaultPlan(BaseModel):
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

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int = Field(default=1, ge=0, lt=2**63)
    lines: tuple[LineFault, ...] = ()
    leds: tuple[LedFault, ...] = ()
    frames: tuple[FrameFault, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _no_truth_values(cls, values: Any) -> Any:
        """Refuse true and false, which the plan's dataclasses would read as 1 and 0."""
        for key in _truth_values(values, ""):
            raise ValueError(f"{key} is true or false; it must be a number or a text")
        return values


def _truth_values(values: Any, path: str) -> Iterator[str]:
    if isinstance(values, bool):
        yield path
    elif isinstance(values, dict):
        for key, value in values.items():
            yield from _truth_values(value, f"{path}.{key}" if path else str(key))
    elif isinstance(values, list | tuple):
        for index, value in enumerate(values):
            yield from _truth_values(value, f"{path}.{index}")
