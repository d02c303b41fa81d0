"""Acceptance levels of light images, shared by the doctor, captures and the preview.

A rig without a fault in the doctor's report therefore delivers sets that are accepted. Shares are
of full scale unless stated otherwise. In ``tests/capture/acquisition`` the fault matrix bounds the
limits from above (no set with wrong light is accepted), and ``test_clean_sets.py`` from below (no
good set is rejected).
"""

# Signal of an LED (mean of its light image above ambient light) as a share of the brightest LED's.
# Low enough for a part that is half in shadow, high enough that noise does not dominate a slope.
DEAD_LED_SHARE = 0.1
# Share of the signal of the other LEDs below which an LED is weak: relative to the signal, its shot
# noise is then 1.4 times theirs, and its read noise twice.
WEAK_LED_SHARE = 0.5
# Least signal of an LED as a share of full scale: 8 of 4095 at 12 bit. A weaker one is lost in the
# rounding. For photographs, whose depth may be a guess: of the brightest signal.
MIN_SIGNAL_SHARE = 0.002
# Share of the pixels of a light image at full scale. The solver masks a few specular glints.
MAX_SATURATED_SHARE = 0.01
# The same of a photograph. One of a gilded icon, with 39 %, was usable.
MAX_SATURATED_SHARE_OF_PHOTOGRAPH = 0.5
# Mean of the ambient image that causes a warning, because of its shot noise in every light image.
HIGH_AMBIENT_SHARE = 0.1
# Mean of the ambient image that causes a fault: the LEDs have less than half of the range.
MAX_AMBIENT_SHARE = 0.5

# The limits below are rms shares of the signal, or relative LED levels. Errors of the mean normal
# at slant 45 degrees: 1.6 degrees for an LED level that is wrong by 2 %, 4.0 degrees for 5 %, and
# 1.4 degrees for 2 % of ambient light that is not subtracted.
# Difference of the two ambient images of a set.
MAX_AMBIENT_CHANGE = 0.02
# Redundancy residual of four light images; above it they are compared with a retake.
MAX_REDUNDANCY_RESIDUAL = 0.02
# Difference of a light image from its retake.
MAX_RETAKE_CHANGE = 0.02
# Difference of the level of one LED from the others.
MAX_LED_LEVEL_DIFFERENCE = 0.04
# Largest standard error of a known level, and least significant difference in standard errors.
MAX_LED_LEVEL_ERROR = 0.01
_LED_LEVEL_STANDARD_ERRORS = 4.0
# Levels within this of the configured ones need no correction: half of what a capture accepts.
EQUAL_LED_LEVELS = 0.02
# Share of the detail of a photograph that a linear combination of the other photographs explains:
# least share, and the share below which it is a warning. Photographs of four real objects reach
# 0.51, with one of another scene 0.22 (tests/evidence/photograph_rates.py).
MIN_EXPLAINED_DETAIL, LITTLE_EXPLAINED_DETAIL = 0.3, 0.4
# Least share of rows in which the four light images are compared: a row left out may be torn.
MIN_COMPARED_ROW_SHARE = 1.0


def led_level_limit(error: float) -> float:
    """Difference of LED levels, known with a standard error, beyond which images are rejected."""
    return max(MAX_LED_LEVEL_DIFFERENCE, _LED_LEVEL_STANDARD_ERRORS * error)
