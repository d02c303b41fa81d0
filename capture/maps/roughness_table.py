"""Roughness parameters with names and units."""

from typing import Any

from classify import Roughness

ROUGHNESS_NOTE = (
    "ISO 25178-2 over the valid pixels, at the scale of a pixel; noise raises all of them. Sa and "
    "Sq come from relative height without its mean plane and are not lengths: compare them only "
    "between images of one size and magnification."
)
_PARAMETERS = (
    ("Sdq", "root mean square gradient", "sdq", "1", False),
    ("Sdr", "developed interfacial area ratio", "sdr_percent", "%", False),
    ("Sa", "arithmetical mean height", "sa_px", "px", True),
    ("Sq", "root mean square height", "sq_px", "px", True),
)


def roughness_parameters(roughness: Roughness | None) -> dict[str, dict[str, Any]]:
    """Return name, value and unit of each parameter by symbol, and whether it is relative.

    A value is None if no pixel is valid. Unit 1 means dimensionless. Relative parameters come from
    the integrated height, the others from the gradients themselves.
    """
    return {
        symbol: {
            "name": name, "value": getattr(roughness, field, None), "unit": unit,
            "relative": relative,
        }
        for symbol, name, field, unit, relative in _PARAMETERS
    }  # fmt: skip
