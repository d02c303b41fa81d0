"""Roughness parameters with their names, units and what they rest on."""

from __future__ import annotations

from dataclasses import dataclass

from classify import Roughness

__all__ = ["ROUGHNESS_NOTE", "Parameter", "roughness_parameters"]

ROUGHNESS_NOTE = (
    "ISO 25178-2 over the valid pixels, at the scale of a pixel; noise raises all of them. Sa and "
    "Sq rest on relative height, less its mean plane, and are no lengths: compare them only "
    "between images of one size and magnification."
)


@dataclass(frozen=True)
class Parameter:
    """One parameter; `value` is None where no pixel is valid.

    `relative` is true of what rests on integrated height and not on the gradients themselves.
    """

    symbol: str
    name: str
    value: float | None
    unit: str
    relative: bool


def roughness_parameters(roughness: Roughness | None) -> list[Parameter]:
    """The parameters in the order in which they are shown; unit 1 is dimensionless."""
    sdq, sdr, sa, sq = (
        (roughness.sdq, roughness.sdr_percent, roughness.sa_px, roughness.sq_px)
        if roughness is not None
        else (None,) * 4
    )
    return [
        Parameter("Sdq", "root mean square gradient", sdq, "1", relative=False),
        Parameter("Sdr", "developed interfacial area ratio", sdr, "%", relative=False),
        Parameter("Sa", "arithmetical mean height", sa, "px", relative=True),
        Parameter("Sq", "root mean square height", sq, "px", relative=True),
    ]
