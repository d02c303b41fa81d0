"""Roughness parameters with names and units."""

from typing import Any

from classify import Roughness

_OF_A_PIXEL = "ISO 25178-2 over the valid pixels, at the scale of a pixel"
_RELATIVE_NOTE = (
    f"{_OF_A_PIXEL}; noise raises all of them. Sa and Sq come from relative height without its "
    "mean plane and are not lengths: compare them only between images of one size and "
    "magnification."
)
_LENGTHS_NOTE = (
    "{}, {:.3g} mm; noise raises all of them. Sa and Sq come from height without its mean plane. "
    "Errors of slopes add up over the frame: compare them only between images of one size."
)
_UM_PER_MM = 1e3


def roughness_note(mm_per_px: float | None) -> str:
    """Return what the parameters mean, for a scale that is known or not."""
    return _RELATIVE_NOTE if mm_per_px is None else _LENGTHS_NOTE.format(_OF_A_PIXEL, mm_per_px)


def roughness_parameters(
    roughness: Roughness | None, mm_per_px: float | None
) -> dict[str, dict[str, Any]]:
    """Return name, value and unit of each parameter by symbol, and whether it is relative.

    A value is None if no pixel is valid; Sa and Sq are in um, or relative in px without a scale.
    """
    relative = mm_per_px is None
    unit, per_px = ("px", 1.0) if mm_per_px is None else ("um", _UM_PER_MM * mm_per_px)
    rows = (
        ("Sdq", "root mean square gradient", "sdq", "1", 1.0, False),
        ("Sdr", "developed interfacial area ratio", "sdr_percent", "%", 1.0, False),
        ("Sa", "arithmetical mean height", "sa_px", unit, per_px, relative),
        ("Sq", "root mean square height", "sq_px", unit, per_px, relative),
    )
    return {
        symbol: {
            "name": name,
            "value": None if roughness is None else factor * getattr(roughness, field),
            "unit": unit,
            "relative": relative,
        }
        for symbol, name, field, unit, factor, relative in rows
    }
