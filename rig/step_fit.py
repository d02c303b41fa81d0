"""Estimate stamp offset and readout time from the light of LED steps.

An LED is switched at a known time a, and the frames around it are averaged in bands of rows. A row
that was exposed from S to S + e holds a share F of the step's light. For light that approaches its
level exponentially with time constant tau, and x = S + e - a, the part of the exposure after the
switch,

    F = (G(x) - G(x - e)) / e,    G(x) = x+ - tau (1 - exp(-x+ / tau)),    x+ = max(x, 0),

and the share after a step down is 1 - F. Band b, from 0 to 1, starts at S = s + D + b R, where s is
the reported start of the exposure. D, R and both time constants are fitted to all bands of all
frames. Each frame whose exposure contains a step then gives its own D; their scatter is the
uncertainty of one stamp.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from classify.base.arrays import BoolArray, Floats

# Limits of the share of light in a band whose exposure contains the step. Beyond them, noise
# dominates the time of the step.
_STEP_SHARES = (0.03, 0.97)
# The fit starts from the best point of a grid over the first and the last band: range and step of D
# in periods, number of values of R, tau of a common LED driver. The grid only has to lead to the
# right minimum, which tests/rig/test_latency.py checks for random cameras.
_GRID_RANGE_PERIODS = (-2.0, 3.0)
_GRID_STEP_PERIODS = 0.04
_GRID_READOUTS = 9
_GRID_BANDS = [0, -1]
_GRID_TAU_S = 0.0003
# Limits of |D| and |R| in periods.
_LIMIT_PERIODS = 4.0
# Time constants beyond those of any LED, so that the fit stays finite.
_TAU_LIMITS_S = (1e-6, 0.1)
# Residual from which a share has less weight (soft L1), several times the noise of a band. Frames
# with a jittering stamp or with other light exceed it.
_SOFT_SHARE = 0.01
# Scales of D and R in s, and of the logarithms of both time constants.
_FIT_SCALES = (1e-3, 1e-3, 0.3, 0.3)
_RISE_10_90 = math.log(9.0)


@dataclass(frozen=True, eq=False)
class Steps:
    """Frames around steps of one LED."""

    reported_s: Floats  # (F,) reported exposure start of each frame, relative to its step
    rising: BoolArray  # (F,) whether the LED was switched on
    shares: Floats  # (F, B) of the LED's full light in each band of rows
    bands: Floats  # (B,) position of each band: 0 is the first row, 1 the last
    exposure_s: float
    period_s: float


@dataclass(frozen=True)
class StepFit:
    """The fitted model."""

    start_s: float  # offset from the reported to the true start of the first exposed row
    # Largest deviation of a stamp, plus a standard deviation as margin for other frames.
    deviation_s: float
    readout_s: float  # from the row that is exposed first to the last one
    readout_error_s: float
    bottom_up: bool
    rise_s: float  # 10 to 90 %
    fall_s: float  # 10 to 90 %
    caught: int  # frames whose exposure contains the step
    misfit: float  # rms residual of the shares


def lit_share(lit_s: Floats, exposure_s: float, tau_s: float) -> Floats:
    """F of the module's formula, for rows with `lit_s` = x."""

    def collected(x: Floats) -> Floats:
        lit = np.maximum(x, 0.0)
        return lit + tau_s * np.expm1(-lit / tau_s)

    share: Floats = (collected(lit_s) - collected(lit_s - exposure_s)) / exposure_s
    return share


def fit_steps(steps: Steps) -> StepFit:
    """Fit the module's model to all frames."""
    from scipy.optimize import least_squares

    log_tau = math.log(_GRID_TAU_S)
    low, high = (math.log(limit) for limit in _TAU_LIMITS_S)
    coarse = replace(steps, shares=steps.shares[:, _GRID_BANDS], bands=steps.bands[_GRID_BANDS])
    start = min(
        (
            np.array([offset_s, readout_s, log_tau, log_tau])
            for offset_s in np.arange(*_GRID_RANGE_PERIODS, _GRID_STEP_PERIODS) * steps.period_s
            for readout_s in np.linspace(-steps.period_s, steps.period_s, _GRID_READOUTS)
        ),
        key=lambda values: float(np.abs(_misfit(coarse, values)).sum()),
    )
    span = _LIMIT_PERIODS * steps.period_s
    solution = least_squares(
        lambda values: _misfit(steps, values).ravel(),
        start,
        loss="soft_l1",
        f_scale=_SOFT_SHARE,
        x_scale=_FIT_SCALES,
        bounds=([-span, -span, low, low], [span, span, high, high]),
    )
    offset_s, readout_s = (float(value) for value in solution.x[:2])
    rise_tau_s, fall_tau_s = (math.exp(float(value)) for value in solution.x[2:])
    corrections_s = _frame_corrections_s(steps, offset_s, readout_s, rise_tau_s, fall_tau_s)
    residual = _misfit(steps, solution.x).ravel()
    deviation_s = 0.0
    if len(corrections_s):
        median_s = float(np.median(corrections_s))
        offset_s += median_s
        deviation_s = float(np.abs(corrections_s - median_s).max() + np.std(corrections_s))
    # The bands of a frame share the error of its stamp: they count as one observation.
    readout_error_s = math.sqrt(len(steps.bands) * _readout_variance_s2(solution.jac, residual))
    return StepFit(
        start_s=offset_s + min(readout_s, 0.0),
        deviation_s=deviation_s,
        readout_s=abs(readout_s),
        readout_error_s=readout_error_s,
        bottom_up=readout_s < 0.0,
        rise_s=rise_tau_s * _RISE_10_90,
        fall_s=fall_tau_s * _RISE_10_90,
        caught=len(corrections_s),
        misfit=float(np.sqrt(np.mean(residual**2))),
    )


def _misfit(steps: Steps, values: Floats) -> Floats:
    """(F, B) model minus measurement, for D, R and the logarithms of both time constants."""
    offset_s, readout_s, log_rise, log_fall = (float(value) for value in values)
    lit_s = _lit_s(steps, offset_s, readout_s)
    rising = steps.rising[:, None]
    risen = lit_share(lit_s, steps.exposure_s, math.exp(log_rise))
    fallen = 1.0 - lit_share(lit_s, steps.exposure_s, math.exp(log_fall))
    difference: Floats = np.where(rising, risen, fallen) - steps.shares
    return difference


def _lit_s(steps: Steps, offset_s: float, readout_s: float) -> Floats:
    """(F, B) x of the module's formula: part of each band's exposure after the step."""
    starts_s = steps.reported_s[:, None] + offset_s + steps.bands * readout_s
    return starts_s + steps.exposure_s


def _frame_corrections_s(
    steps: Steps, offset_s: float, readout_s: float, rise_tau_s: float, fall_tau_s: float
) -> Floats:
    """Correction of D by each frame that contains a step: the median of its bands."""
    # F is inverted by interpolation in a table.
    table_s = np.linspace(-0.1 * steps.exposure_s, 1.1 * steps.exposure_s, 4001)
    fitted_s = _lit_s(steps, offset_s, readout_s)
    corrections_s = []
    for rising, tau_s in ((True, rise_tau_s), (False, fall_tau_s)):
        table_shares = lit_share(table_s, steps.exposure_s, tau_s)
        in_direction = steps.rising == rising
        shares = steps.shares[in_direction] if rising else 1.0 - steps.shares[in_direction]
        for frame_shares, lit_s in zip(shares, fitted_s[in_direction], strict=True):
            contains_step = (frame_shares > _STEP_SHARES[0]) & (frame_shares < _STEP_SHARES[1])
            if contains_step.any():
                measured_s = np.interp(frame_shares[contains_step], table_shares, table_s)
                corrections_s.append(float(np.median(measured_s - lit_s[contains_step])))
    return np.array(corrections_s)


def _readout_variance_s2(jacobian: Floats, residual: Floats) -> float:
    """Variance of R, the second fitted value, if all shares of light were independent."""
    degrees = max(residual.size - jacobian.shape[1], 1)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * float(np.sum(residual**2)) / degrees
    return max(float(covariance[1, 1]), 0.0)
