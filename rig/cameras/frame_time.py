"""Exposure of a frame: its start from the driver's time stamp, and its limits."""

from classify.base.errors import ConfigError
from rig.errors import CameraError

from .config import StampedCameraConfig


def exposure_start_s(
    stamp_s: float,
    claims_start: bool,
    config: StampedCameraConfig,
    period_s: float,
    exposure_s: float,
) -> float:
    """Earliest possible start of the first row's exposure, in s on the clock of the stamp.

    `claims_start` tells whether the driver declares its time stamp as the start of exposure, or
    else as the end of the frame. `period_s` and `exposure_s` are as read back from the camera.
    """
    stamp_s += (config.timestamp_offset_ms - config.timestamp_uncertainty_ms) / 1e3
    # The kernel's driver for USB cameras declares the start of exposure and stamps the arrival of
    # the data, so a declaration counts only if the configuration confirms it.
    if config.believes_driver and claims_start:
        return stamp_s
    readout_s = period_s if config.readout_ms is None else config.readout_ms / 1e3
    return stamp_s - readout_s - exposure_s


def start_known_to_s(config: StampedCameraConfig) -> float:
    """Longest time by which an exposure may start after `exposure_start_s`."""
    return 2.0 * config.timestamp_uncertainty_ms / 1e3


def require_measured_mode(config: StampedCameraConfig) -> None:
    """Reject a timing that was measured in another mode of the camera."""
    if config.timing_measured_at not in (None, config.mode):
        raise ConfigError(
            f"camera.timing_measured_at = {config.timing_measured_at!r}, but the camera is set to "
            f"{config.mode!r}; run ps4rig rig latency again, or remove timing_measured_at, "
            "timestamp_offset_ms, timestamp_uncertainty_ms and readout_ms"
        )


def require_exposure(exposure_ms: float, range_ms: tuple[float, float]) -> None:
    """Raise a `CameraError` for an exposure outside of a camera's range."""
    shortest_ms, longest_ms = range_ms
    # The longest exposure is a frame period, which rounding may exceed.
    if not shortest_ms * (1.0 - 1e-9) <= exposure_ms <= longest_ms * (1.0 + 1e-9):
        raise CameraError(
            f"exposure of {exposure_ms:g} ms; the camera takes {shortest_ms:g} to {longest_ms:g} ms"
        )
