"""The plan of a sequence, in which the controller steps through the lights by itself."""

import math
from dataclasses import dataclass

from firmware_sim.firmware import MAX_STEP_US, MAX_STEPS

# Planned time from the end of an exposure until the controller has switched: one or two passes of
# its main loop (0.2 ms each at most, `controller_turn_us`) and the delay of an optocoupler. Each
# set measures the true one, and `ps4rig rig timing` prints it.
REACTION_S = 0.0005
# A strobe without an edge for this long beyond the frame period counts as disconnected; so does a
# camera that stalls.
_STROBE_PATIENCE_S = 0.25


@dataclass(frozen=True)
class SequencePlan:
    """The steps of one set.

    Attributes
    ----------
    lights
        The lights in their order; None is a dark step.
    triggers
        Whether the controller steps by time and triggers each exposure. Otherwise the camera runs
        free, and the controller steps at the end of each exposure on the strobe line.
    settle_us
        Least time from the change of a light to the exposure that counts.
    wait_us
        Time between two triggers, or longest wait for a strobe edge.
    frames_per_step
        1, or more if a light cannot settle between two exposures.
    exposed_s
        From the beginning of the first row's exposure to the end of the last row's.
    duration_s
        Longest time from the start to the end of a sequence without faults.
    """

    lights: tuple[int | None, ...]
    triggers: bool
    settle_us: int
    wait_us: int
    frames_per_step: int
    exposed_s: float
    duration_s: float


def plan_sequence(
    light_count: int, *, triggers: bool, settle_s: float, period_s: float, exposed_s: float
) -> SequencePlan:
    """Plan a dark step and one step for each light, as fast as lights and camera allow."""
    lights = (None, *range(light_count))
    if len(lights) > MAX_STEPS:
        raise ValueError(
            f"a sequence has {MAX_STEPS} steps, too few for {light_count} lights; set "
            "lights.synchronisation = 'software'"
        )
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
        raise ValueError(
            f"steps of {wait_s:.3g} s are too long for the controller, which takes "
            f"{1e-6 * MAX_STEP_US:g} s; shorten exposure, frame period or settle time"
        )
    return SequencePlan(lights, triggers, settle_us, wait_us, frames, exposed_s, duration_s)
