"""The section ``[lights]`` of ``rig.toml``, and the plan of a sequence of its lights."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from classify import Lighting
from classify.base.models import Degrees, Section
from classify.lighting import RING_TILTS_DEG
from firmware_sim.firmware import (
    MAX_STEP_US,
    MAX_STEPS,
    WATCHDOG_DEFAULT_MS,
    WATCHDOG_MAX_MS,
    WATCHDOG_MIN_MS,
)

SIMULATED = "simulated"
"""Value of `port` for the simulated controller: the firmware on a TCP port of this machine."""
AUTO = "auto"
"""Value of `port` for a controller that is searched for."""
_Intensity = Annotated[float, Field(ge=0.01, le=100.0)]


def led_names(tilts_deg: Iterable[float]) -> list[str]:
    """Return names of LEDs for people: their numbers at the controller, and where they stand."""
    # Directions are measured or rounded: tilts of 89.9999 degrees have no place in a name.
    return [f"LED {led} (tilt {round(tilt_deg)})" for led, tilt_deg in enumerate(tilts_deg)]


class LightsConfig(Section):
    """The LED controller, and the positions of its LEDs."""

    port: str = Field(
        default=SIMULATED,
        min_length=1,
        description="auto, a serial port, a pyserial URL, or simulated; a file must give it",
    )
    serial_number: str | None = Field(
        default=None,
        min_length=1,
        max_length=200,
        description='of the controller or its USB device, with port = "auto"',
    )
    usb_id: str | None = Field(
        default=None,
        pattern=r"^[0-9a-f]{4}:[0-9a-f]{4}$",
        description='vendor and product, such as "2e8a:0005", with port = "auto"',
    )
    baud: int = Field(default=115_200, ge=300, le=12_000_000, description="of the serial line")
    tilts_deg: tuple[Degrees, ...] = Field(
        default=RING_TILTS_DEG,
        min_length=3,
        max_length=64,
        strict=False,
        description="of LED 0, 1, 2 ..., anticlockwise from the right of the image",
    )
    slant_deg: float = Field(
        default=45.0, gt=0.0, le=85.0, description="of all LEDs, from the camera's axis"
    )
    intensities: tuple[_Intensity, ...] = Field(
        default=(), strict=False, description="LED levels as built, relative to each other"
    )
    settle_ms: float = Field(
        default=5.0,
        ge=0.0,
        le=10_000.0,
        description="from the acknowledgement of a switch until the light is steady",
    )
    watchdog_ms: int = Field(
        default=WATCHDOG_DEFAULT_MS,
        ge=WATCHDOG_MIN_MS,
        le=WATCHDOG_MAX_MS,
        description="silence after which the controller puts the LEDs out",
    )
    synchronisation: Literal["software", "strobe", "trigger"] = Field(
        default="software", description="what switches the lights during a set"
    )

    @field_validator("usb_id", mode="before")
    @classmethod
    def _usb_id_in_lower_case(cls, usb_id: Any) -> Any:
        return usb_id.lower() if isinstance(usb_id, str) else usb_id

    @model_validator(mode="after")
    def _search_keys_need_port_auto(self) -> Self:
        if self.port != AUTO and (self.serial_number is not None or self.usb_id is not None):
            raise ValueError(
                f"serial_number and usb_id are for port = {AUTO!r}, but port is {self.port!r}; "
                f"leave them out, or set port = {AUTO!r}"
            )
        return self

    @model_validator(mode="after")
    def _one_intensity_each(self) -> Self:
        if len(self.intensities) not in (0, len(self.tilts_deg)):
            raise ValueError(
                f"{len(self.intensities)} intensities for {len(self.tilts_deg)} LEDs; give one each"
            )
        return self

    @property
    def lighting(self) -> Lighting:
        """Directions and relative intensities of the lights."""
        return _lighting(self.tilts_deg, self.slant_deg, self.intensities)


@lru_cache(maxsize=16)  # a capture needs it a dozen times
def _lighting(
    tilts_deg: tuple[float, ...], slant_deg: float, intensities: tuple[float, ...]
) -> Lighting:
    ring = Lighting.from_angles(tilts_deg, slant_deg)
    return Lighting(ring.directions, np.array(intensities))


# Planned time from the end of an exposure until the controller has switched: up to two passes of
# its main loop (of 0.2 ms, `simulation.controller_turn_us`) and the delay of an optocoupler. Each
# set measures the true time, and `ps4rig rig timing` prints it.
REACTION_S = 0.0005
# Time beyond the frame period after which a strobe without an edge counts as disconnected.
_STROBE_TIMEOUT_S = 0.25


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
        wait_s = max(period_s, settle_s) + _STROBE_TIMEOUT_S
        # Two more periods: until the first exposure begins, and as a margin.
        duration_s = (frames * len(lights) + 2) * period_s + settle_s
    settle_us, wait_us = math.ceil(1e6 * settle_s), math.ceil(1e6 * wait_s)
    if wait_us > MAX_STEP_US:
        raise ValueError(
            f"steps of {wait_s:.3g} s are too long for the controller, which takes "
            f"{1e-6 * MAX_STEP_US:g} s; shorten exposure, frame period or settle time"
        )
    return SequencePlan(lights, triggers, settle_us, wait_us, frames, exposed_s, duration_s)
