"""When a frame was exposed, from what its driver stamped on it."""

from __future__ import annotations

from .config.camera import StampedCameraConfig
from .errors import ConfigError

__all__ = ["exposure_start_s", "require_measured_mode", "start_known_to_s"]


def exposure_start_s(
    stamp_s: float,
    claims_start: bool,
    config: StampedCameraConfig,
    period_s: float,
    exposure_s: float,
) -> float:
    """When the exposure of the first row began, at the earliest.

    Parameters
    ----------
    stamp_s
        The driver's time stamp.
    claims_start
        Whether the driver calls it the start of exposure; else it is the frame's end.
    config
        What is known of the stamp, and whether the driver is believed.
    period_s, exposure_s
        As read back from the camera.
    """
    stamp_s += (config.timestamp_offset_ms - config.timestamp_uncertainty_ms) / 1e3
    # The driver of USB cameras claims the start of exposure and stamps the arrival of data, so
    # the claim counts only where somebody has tried it.
    if config.believes_driver and claims_start:
        return stamp_s
    readout_s = period_s if config.readout_ms is None else config.readout_ms / 1e3
    return stamp_s - readout_s - exposure_s


def start_known_to_s(config: StampedCameraConfig) -> float:
    """By how much later than `exposure_start_s` says an exposure may have begun."""
    return 2.0 * config.timestamp_uncertainty_ms / 1e3


def require_measured_mode(config: StampedCameraConfig) -> None:
    """Refuse a timing that was measured in another mode of the camera.

    Raises
    ------
    ConfigError
        If `timing_measured_at` is given and not the configured mode.
    """
    if config.timing_measured_at not in (None, config.mode):
        raise ConfigError(
            f"camera.timing_measured_at = {config.timing_measured_at!r}, but the camera is set to "
            f"{config.mode!r}; run ps4rig rig latency again, or take timing_measured_at, "
            "timestamp_offset_ms, timestamp_uncertainty_ms and readout_ms away"
        )
