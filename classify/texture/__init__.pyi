from .angular_harmonics import HARMONICS, Complex, harmonics, least_error, unturned_norms
from .fields import TextureFields, texture_fields
from .filter_bank import mr8_responses
from .heading import HEADING_FLOATS, LEAST_SCORE, heading_numbers, heading_scores, heading_variances
from .orientation import STEP_DEG, roll_angles, squared_errors_by_turn, turn_of_least_error
from .spectra import (
    ANGLES,
    MAX_SEGMENT_PX,
    MIN_SEGMENT_PX,
    RADII,
    Spectra,
    field_spectra,
    image_spectrum,
    polar_radii_px,
    segment_for,
    surface_spectra,
)
from .statistics import (
    PARTS,
    LocalStatistics,
    levels_for,
    local_statistics,
    statistics_vector,
)
from .textons import chi_squared, learn_textons, texton_histogram
from .turned_lights import under_turned_lights

__all__ = [
    "ANGLES",
    "HARMONICS",
    "HEADING_FLOATS",
    "LEAST_SCORE",
    "MAX_SEGMENT_PX",
    "MIN_SEGMENT_PX",
    "PARTS",
    "RADII",
    "STEP_DEG",
    "Complex",
    "LocalStatistics",
    "Spectra",
    "TextureFields",
    "chi_squared",
    "field_spectra",
    "harmonics",
    "heading_numbers",
    "heading_scores",
    "heading_variances",
    "image_spectrum",
    "learn_textons",
    "least_error",
    "levels_for",
    "local_statistics",
    "mr8_responses",
    "polar_radii_px",
    "roll_angles",
    "segment_for",
    "squared_errors_by_turn",
    "statistics_vector",
    "surface_spectra",
    "texton_histogram",
    "texture_fields",
    "turn_of_least_error",
    "under_turned_lights",
    "unturned_norms",
]
