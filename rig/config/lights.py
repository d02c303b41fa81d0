"""The section ``[lights]`` of ``rig.toml``: controller and positions of its LEDs."""

from collections.abc import Iterable
from functools import lru_cache
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, FiniteFloat, field_validator, model_validator

from classify import Lighting
from classify.base.models import Degrees, Section
from classify.lighting import RING_TILTS_DEG
from firmware_sim.firmware import WATCHDOG_DEFAULT_MS, WATCHDOG_MAX_MS, WATCHDOG_MIN_MS

SIMULATED = "simulated"
"""Value of `port` for the simulated controller: the firmware on a pty of this machine."""
AUTO = "auto"
"""Value of `port` for a controller that is searched for."""
_Intensity = Annotated[FiniteFloat, Field(ge=0.01, le=100.0)]


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
        description="from the acknowledge of a switch until the light is steady",
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

    @property
    def lighting(self) -> Lighting:
        """Directions and relative intensities of the lights."""
        return _lighting(self.tilts_deg, self.slant_deg, self.intensities)

    @model_validator(mode="after")
    def _one_intensity_each(self) -> Self:
        if len(self.intensities) not in (0, len(self.tilts_deg)):
            raise ValueError(
                f"{len(self.intensities)} intensities for {len(self.tilts_deg)} LEDs; give one each"
            )
        return self


@lru_cache(maxsize=16)  # a capture asks a dozen times
def _lighting(
    tilts_deg: tuple[float, ...], slant_deg: float, intensities: tuple[float, ...]
) -> Lighting:
    ring = Lighting.from_angles(tilts_deg, slant_deg)
    return Lighting(ring.directions, np.array(intensities))
