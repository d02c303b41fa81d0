"""The section ``[simulation]`` of ``rig.toml``: what only a simulated rig has."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, FiniteFloat

from .fault_plan import FaultPlan
from .section import Degrees, Section

__all__ = ["Placement", "SimulationConfig"]

TurnTime = Annotated[FiniteFloat, Field(ge=1.0, le=1e6)]
Shift = Annotated[FiniteFloat, Field(ge=-1e6, le=1e6)]


class Placement(Section):
    """Which part lies under the simulated camera, and how.

    `surface` is rock, sand, malv, ogil, a bundled material or a material folder. The patch's
    centre is moved by `shift_px` (x right, y up) over the periodic surface, then the surface is
    turned anticlockwise by `rotate_deg` about that centre. `seed` chooses the noise, and for the
    four synthetic surfaces their realisation.
    """

    surface: str = "rock"
    rotate_deg: Degrees = 0.0
    shift_px: tuple[Shift, Shift] = Field(default=(0.0, 0.0), strict=False)
    seed: int = Field(default=1, ge=0, lt=2**63)


class SimulationConfig(Section):
    """What only a simulated rig has.

    `clock` is ``virtual`` (a set takes milliseconds) or ``real`` (it takes what frames take).
    `ambient` is the light that no LED makes, as a fraction of one LED at full level. `readout_ms`
    is from the first row's exposure to the last row's, 0 for a global shutter. `faults` are what
    goes wrong, on purpose; a ``rig.toml`` has them or names their file. `controller_turn_us` is the
    least and the most time of one turn of the controller's main loop: so late may it be to switch
    after the end of an exposure.

    The camera's driver stamps the start of exposure and is right. With a `stamp_lag_ms` it stamps
    each frame so much later than that, as drivers do that stamp the arrival of data, and up to
    `stamp_jitter_ms` more; what its stamp means is then for ``ps4rig rig latency`` to find out.
    """

    clock: Literal["virtual", "real"] = "virtual"
    ambient: float = Field(default=0.02, ge=0.0, le=1.0)
    led_rise_ms: float = Field(default=0.5, gt=0.0, le=100.0)
    led_fall_ms: float = Field(default=0.3, gt=0.0, le=100.0)
    controller_turn_us: tuple[TurnTime, TurnTime] = Field(default=(50.0, 200.0), strict=False)
    readout_ms: float = Field(default=0.0, ge=0.0, le=10_000.0)
    stamp_lag_ms: float | None = Field(default=None, ge=-1000.0, le=1000.0)
    stamp_jitter_ms: float = Field(default=0.0, ge=0.0, le=100.0)
    placement: Placement = Placement()
    faults: FaultPlan | None = None
