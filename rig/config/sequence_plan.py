"""What the controller is asked to do where it steps through the lights by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_sim.firmware import DARK, MAX_STEP_US, MAX_STEPS

__all__ = ["SequencePlan", "plan_sequence"]

# From the end of an exposure until the controller has switched: a turn or two of its main loop,
# and what an optocoupler takes. It is measured in each set; this much is planned for.
REACTION_S = 0.0005
# Without an edge for so long beyond the frame period, the strobe is not connected.
_STROBE_PATIENCE_S = 0.25


@dataclass(frozen=True)
class SequencePlan:
    """What the controller is asked to do for one set.

    Attributes
    ----------
    lights
        In their order; None is a dark step.
    triggers
        True: the controller steps by time and triggers each exposure; False: the camera runs
        free, and the end of each exposure on its strobe line is a step.
    settle_us
        Least time from a light's change to the exposure that counts.
    wait_us
        With triggers, from one to the next; else how long an edge may be missing.
    frames_per_step
        1, or more if a light has no time to settle between one exposure and the next.
    exposed_s
        From the beginning of the first row's exposure to the end of the last row's.
    duration_s
        From the start to the end, at most, if nothing goes wrong.
    """

    lights: tuple[int | None, ...]
    triggers: bool
    settle_us: int
    wait_us: int
    frames_per_step: int
    exposed_s: float
    duration_s: float

    @property
    def command(self) -> str:
        """The line that starts it."""
        verb = "TRIG" if self.triggers else "ARM"
        order = ",".join(str(DARK if light is None else light) for light in self.lights)
        return f"SEQ:{verb} {self.settle_us},{self.wait_us},{order}"


def plan_sequence(
    light_count: int, *, triggers: bool, settle_s: float, period_s: float, exposed_s: float
) -> SequencePlan:
    """A dark step and one for each light, as fast as lights and camera allow.

    Parameters
    ----------
    light_count
        Lights of the rig.
    triggers
        Whether the controller triggers the camera.
    settle_s
        From the switch until the light is steady.
    period_s
        The camera's frame period; with triggers, the least time between two.
    exposed_s
        From the beginning of the first row's exposure to the end of the last row's.

    Raises
    ------
    ValueError
        If there are too many lights, or no pause between two exposures.
    """
    lights = (None, *range(light_count))
    if len(lights) > MAX_STEPS:
        raise ValueError(f"a sequence has {MAX_STEPS} steps, too few for {light_count} lights")
    busy_s = settle_s + REACTION_S + exposed_s
    if triggers:
        wait_s, frames = max(period_s, busy_s), 1
        duration_s = len(lights) * (wait_s + REACTION_S)
    else:
        if exposed_s + REACTION_S > period_s:
            raise ValueError(
                f"the camera exposes for {1e3 * exposed_s:.4g} ms of a frame period of "
                f"{1e3 * period_s:.4g} ms, and its strobe has no pause; shorten the exposure"
            )
        frames = math.ceil(busy_s / period_s)
        wait_s = max(period_s, settle_s) + _STROBE_PATIENCE_S
        duration_s = (frames * len(lights) + 2) * period_s + settle_s
    settle_us, wait_us = math.ceil(1e6 * settle_s), math.ceil(1e6 * wait_s)
    if wait_us > MAX_STEP_US:
        raise ValueError(f"steps of {wait_s:.3g} s are too long for the controller")
    return SequencePlan(lights, triggers, settle_us, wait_us, frames, exposed_s, duration_s)
