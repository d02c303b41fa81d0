"""From the light of many steps to what the camera's time stamp means.

An LED is switched at a known time and the frames around it are looked at in bands of rows. Of a
row that was exposed from S to S + e, a share F of the step's light is in the picture; with a
light that approaches its level exponentially, time constant tau, and x = S + e - a the time that
row had left when the LED was switched at a,

    F = (G(x) - G(x - e)) / e,    G(x) = x+ - tau (1 - exp(-x+ / tau)),    x+ = max(x, 0),

and 1 - F of it is left after a step down. Band b of the frame begins at S = s + D + b R, where s
is when the stamp says that the exposure began. D, R and both time constants are fitted to all
bands of all frames at once. Then each frame that caught a step is asked for its own D: how far
these differ is how far one stamp may be trusted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

__all__ = ["StepFit", "Steps", "fit_steps", "lit_share"]

Floats = npt.NDArray[np.float64]

# Shares between these are of a frame that caught the step.
_CAUGHT = (0.03, 0.97)
_GRID_PERIODS = 0.04
_GRID_READOUTS = 9
_FEW = [0, -1]
_GRID_TAU_S = 0.0003
_TAU_LIMITS_S = (1e-6, 0.1)
# From this difference on a share counts less: a frame whose stamp jittered, or a cloud.
_SOFT_SHARE = 0.01
_RISE_10_90 = math.log(9.0)


@dataclass(frozen=True, eq=False)
class Steps:
    """Frames around steps of one LED.

    Attributes
    ----------
    reported_s
        (F,) when each frame's exposure began, by its stamp, counted from its step.
    rising
        (F,) bool, whether its step was one up.
    shares
        (F, B) how much of the LED's full light is in each band of rows, 0 to 1.
    bands
        (B,) where the bands are: 0 is the first row, 1 the last.
    exposure_s, period_s
        Of the camera.
    """

    reported_s: Floats
    rising: npt.NDArray[np.bool_]
    shares: Floats
    bands: Floats
    exposure_s: float
    period_s: float


@dataclass(frozen=True)
class StepFit:
    """What follows from the steps.

    Attributes
    ----------
    start_s
        From the reported to the true start of the exposure of the row that comes first.
    deviation_s
        The most by which a frame's own value differed from it, and their standard deviation on
        top, for frames that were not seen.
    readout_s, readout_error_s
        From the row that comes first to the one that comes last, with its standard error.
    bottom_up
        Whether the last row of the picture comes first.
    rise_s, fall_s
        10 % to 90 % times of the light.
    caught
        Frames that caught a step.
    misfit
        Root mean square of what the model leaves of the shares.
    """

    start_s: float
    deviation_s: float
    readout_s: float
    readout_error_s: float
    bottom_up: bool
    rise_s: float
    fall_s: float
    caught: int
    misfit: float


def lit_share(left_s: Floats, exposure_s: float, tau_s: float) -> Floats:
    """F of the module's formula: the share of a step's light in rows with `left_s` to go."""

    def collected(x: Floats) -> Floats:
        lit = np.maximum(x, 0.0)
        return lit + tau_s * np.expm1(-lit / tau_s)

    share: Floats = (collected(left_s) - collected(left_s - exposure_s)) / exposure_s
    return share


def fit_steps(steps: Steps) -> StepFit:
    """Fit the model to all frames; see the module."""
    from scipy.optimize import least_squares

    log_tau = math.log(_GRID_TAU_S)
    low, high = (math.log(limit) for limit in _TAU_LIMITS_S)
    few = replace(steps, shares=steps.shares[:, _FEW], bands=steps.bands[_FEW])
    begin = min(
        (
            np.array([start_s, readout_s, log_tau, log_tau])
            for start_s in np.arange(-2.0, 3.0, _GRID_PERIODS) * steps.period_s
            for readout_s in np.linspace(-steps.period_s, steps.period_s, _GRID_READOUTS)
        ),
        key=lambda values: float(np.abs(_misfit(few, values)).sum()),
    )
    span = 4.0 * steps.period_s
    found = least_squares(
        lambda values: _misfit(steps, values).ravel(),
        begin,
        loss="soft_l1",
        f_scale=_SOFT_SHARE,
        x_scale=(1e-3, 1e-3, 0.3, 0.3),
        bounds=([-span, -span, low, low], [span, span, high, high]),
    )
    start_s, readout_s = (float(value) for value in found.x[:2])
    rise_s, fall_s = (math.exp(float(value)) for value in found.x[2:])
    left = _misfit_of_start(steps, start_s, readout_s, rise_s, fall_s)
    residual = _misfit(steps, found.x).ravel()
    if len(left):
        start_s += float(np.median(left))
        left = left - np.median(left)
    # What one frame's stamp is off by all its bands are off by.
    readout_error_s = math.sqrt(len(steps.bands)) * _error_of(1, found.jac, residual)
    return StepFit(
        start_s=start_s + min(readout_s, 0.0),
        deviation_s=float(np.abs(left).max(initial=0.0) + np.std(left)) if len(left) else 0.0,
        readout_s=abs(readout_s),
        readout_error_s=readout_error_s,
        bottom_up=readout_s < 0.0,
        rise_s=rise_s * _RISE_10_90,
        fall_s=fall_s * _RISE_10_90,
        caught=len(left),
        misfit=float(np.sqrt(np.mean(residual**2))),
    )


def _misfit(steps: Steps, values: Floats) -> Floats:
    """(F, B) model less measurement, for D, R and the logarithms of both time constants."""
    start_s, readout_s, log_rise, log_fall = (float(value) for value in values)
    left = _left_s(steps, start_s, readout_s)
    rising = steps.rising[:, None]
    risen = lit_share(left, steps.exposure_s, math.exp(log_rise))
    fallen = 1.0 - lit_share(left, steps.exposure_s, math.exp(log_fall))
    difference: Floats = np.where(rising, risen, fallen) - steps.shares
    return difference


def _left_s(steps: Steps, start_s: float, readout_s: float) -> Floats:
    """(F, B): how long each band is still exposed after its step; below 0 it was over."""
    begins = steps.reported_s[:, None] + start_s + steps.bands * readout_s
    return begins + steps.exposure_s


def _misfit_of_start(
    steps: Steps, start_s: float, readout_s: float, rise_s: float, fall_s: float
) -> Floats:
    """By how much each frame that caught a step has its own start, from its bands' median."""
    table_s = np.linspace(-0.1 * steps.exposure_s, 1.1 * steps.exposure_s, 4001)
    expected = _left_s(steps, start_s, readout_s)
    differences = []
    for rising, tau_s in ((True, rise_s), (False, fall_s)):
        curve = lit_share(table_s, steps.exposure_s, tau_s)
        chosen = steps.rising == rising
        shares = steps.shares[chosen] if rising else 1.0 - steps.shares[chosen]
        for frame, left in zip(shares, expected[chosen], strict=True):
            caught = (frame > _CAUGHT[0]) & (frame < _CAUGHT[1])
            if caught.any():
                seen = np.interp(frame[caught], curve, table_s)
                differences.append(float(np.median(seen - left[caught])))
    return np.array(differences)


def _error_of(index: int, jacobian: Floats, residual: Floats) -> float:
    """Standard error of one fitted value."""
    degrees = max(residual.size - jacobian.shape[1], 1)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * float(np.sum(residual**2)) / degrees
    return math.sqrt(max(float(covariance[index, index]), 0.0))
