"""What goes wrong on a simulated rig, on purpose."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from firmware_sim.faults import LedFault, LineFault
from rig.simulation.frame_faults import FrameFault

__all__ = ["FaultPlan"]


class FaultPlan(BaseModel):
    """Faults of a simulated rig, injected below the drivers.

    Attributes
    ----------
    seed
        Of all that is left to chance.
    lines, leds, frames
        Faults of the serial line, of the LEDs' light, of the camera's frames.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int = Field(default=1, ge=0, lt=2**63)
    lines: tuple[LineFault, ...] = ()
    leds: tuple[LedFault, ...] = ()
    frames: tuple[FrameFault, ...] = ()
