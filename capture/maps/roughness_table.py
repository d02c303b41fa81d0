"""Roughness parameters with names and units."""

from __future__ import annotations

from dataclasses import dataclass

from classify import Roughness

__all__ = ["ROUGHNESS_NOTE", "Parameter", "roughness_parameters"]

ROUGHNESS_NOTE = (
    "ISO 25178-2 over the valid pixels, at the scale of a pixel; noise raises all of them. Sa and "
    "Sq come from relative height without its mean plane and are not lengths: compare them only "
    "between images of one size and magnification."
)


@dataclass(frozen=True)
class Parameter:
    """One parameter; `value` is None if no pixel is valid.

    `relative` is true if it comes from integrated height and not from the gradients themselves.
    """

    symbol: str
    name: str
    value: float | None
    unit: str
    relative: bool


def roughness_parameters(roughness: Roughness | None) -> list[Parameter]:
    """Return the parameters in the order of the table; unit 1 means dimensionless."""
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
