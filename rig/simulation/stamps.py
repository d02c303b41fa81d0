"""Time stamps of a simulated driver, and the exposure times that the rig derives."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rig.cameras.frame_time import exposure_start_s, require_measured_mode, start_known_to_s
from rig.cameras.simulated import ReplayCameraConfig, SimulatedCameraConfig
from rig.config.simulation import SimulationConfig

# Separates the random numbers of time stamps from those of pixels.
_JITTER_STREAM = 1


@dataclass(frozen=True)
class ReportedTiming:
    """The timing that a simulated camera reports of its exposures."""

    # of a sequence number and the true start
    start_s: Callable[[int, float], float] = lambda _sequence, start_s: start_s
    readout_s: float | None = None
    start_known_to_s: float = 0.0  # how much later an exposure may start


def reported_timing(
    camera: SimulatedCameraConfig | ReplayCameraConfig, simulation: SimulationConfig
) -> ReportedTiming:
    """The timing that the rig derives from the stamps of a simulated driver."""
    require_measured_mode(camera)
    period_s, exposure_s = 1.0 / camera.frame_rate_hz, camera.exposure_ms / 1e3
    lag_ms = simulation.stamp_lag_ms

    def reported_start_s(sequence: int, start_s: float) -> float:
        stamp_s = start_s
        if lag_ms is not None:
            stamp_s += lag_ms / 1e3
            if simulation.stamp_jitter_ms > 0.0:
                rng = np.random.default_rng((simulation.placement.seed, sequence, _JITTER_STREAM))
                stamp_s += rng.uniform(0.0, simulation.stamp_jitter_ms / 1e3)
        return exposure_start_s(stamp_s, lag_ms is None, camera, period_s, exposure_s)

    readout_ms = simulation.readout_ms if lag_ms is None else camera.readout_ms
    return ReportedTiming(
        start_s=reported_start_s,
        readout_s=None if readout_ms is None else readout_ms / 1e3,
        start_known_to_s=max(0.0, -reported_start_s(0, 0.0))
        if lag_ms is None
        else start_known_to_s(camera),
    )
