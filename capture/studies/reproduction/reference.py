"""Numbers of others to stand beside ours, in percent.

The thesis is J. Wu, *Rotation Invariant Classification of 3D Surface Texture Using Photometric
Stereo*, PhD, Heriot-Watt University 2003, chapter 9. `NOTES_` are measurements that this program
was designed by, on surfaces and materials like those here, of other realisations and patches.
"""

from __future__ import annotations

__all__ = [
    "GIVEN_SAND_SHADOW",
    "NOTES_MATERIALS",
    "NOTES_REJECTION",
    "NOTES_SYNTHETIC",
    "NOTES_TWINS",
    "NOT_IN_IT",
    "THESIS_PS3_1D",
    "THESIS_PS4_1D",
    "THESIS_PS4_2D",
    "THESIS_SHADOW_WORST",
    "THESIS_TEXTONS",
]

NOT_IN_IT = "not in it"

THESIS_PS3_1D = 90.56
THESIS_PS4_1D = 95.93
THESIS_PS4_2D = 99.07
THESIS_TEXTONS = 100.0
THESIS_SHADOW_WORST = 95.83

GIVEN_SAND_SHADOW = {40: 1.0, 50: 7.0, 60: 19.0, 70: 37.0, 80: 61.0}
"""Pixels of sand in shadow of a light at tilt 0, by slant."""

BySlant = dict[int, tuple[float, float, float]]

NOTES_SYNTHETIC: dict[str, tuple[str, BySlant]] = {
    "joint": (
        "log spectra over all turns",
        {30: (100.0, 100.0, 100.0), 50: (98.3, 100.0, 100.0), 70: (73.3, 94.6, 99.86)},
    ),
    "joint, small": (
        "log spectra over all turns, 128 px",
        {30: (94.9, 95.0, 94.9), 50: (93.5, 94.9, 94.7), 70: (61.7, 86.0, 93.8)},
    ),
    "spectra_2d": (
        "magnitude, Hann window, one segment",
        {30: (79.3, 79.0, 79.7), 50: (79.2, 79.3, 80.3), 70: (45.8, 78.1, 82.5)},
    ),
    "spectra_2d_power": (
        "power, no window",
        {30: (28.5, 27.8, 28.2), 50: (28.3, 26.8, 27.5), 70: (18.3, 30.3, 29.4)},
    ),
    "polar_radial": (
        "magnitude, Hann window, one segment",
        {30: (95.1, 95.4, 95.7), 50: (90.3, 95.6, 95.4), 70: (52.9, 79.0, 94.0)},
    ),
    "polar": (
        "of M",
        {30: (67.8, 67.5, 67.1), 50: (65.0, 67.5, 67.4), 70: (43.9, 66.9, 71.4)},
    ),
}
"""By classifier: what it was there, and by slant accuracy with PS3, PS4, PS4 with in-filling."""

NOTES_TWINS = 100.0

NOTES_MATERIALS: dict[tuple[str, str], dict[int, str]] = {
    ("joint", "disjoint"): {128: "96", 256: "100", 320: "100"},
    ("spectra_2d", "disjoint"): {128: "66", 256: "72-86", 320: "78-88"},
    ("polar_radial", "disjoint"): {128: "67", 256: "80-82", 320: "81-87"},
    ("joint", "turned"): {256: "99"},
    ("spectra_2d", "turned"): {256: "100"},
    ("polar_radial", "turned"): {256: "100"},
}
"""By classifier and protocol, by side of the patches in px."""

NOTES_REJECTION: dict[str, dict[str, str]] = {
    "thesis": {"slant 30": "100", "slant 50": "100", "slant 70": "100", "materials": "88"},
    "spectra": {"slant 30": "2.9", "slant 50": "2.9", "slant 70": "28.6", "materials": "55-58"},
    "plain": {"materials": "8-18"},
}
"""By score and tests: unknown accepted at 1 % false rejection."""
