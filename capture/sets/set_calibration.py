"""The setting of a captured set, and the calibration that holds for it."""

from pathlib import Path

from capture.calibration.lookup import FoundCalibration, find_calibration
from capture.calibration.setting import Setting

from .metadata import SetMetadata


def calibration_of(
    path: Path,
    metadata: SetMetadata,
    shape: tuple[int, ...],
    given: Path | None = None,
    way_out: str = "give --calibration CAL, or solve --raw without one",
) -> FoundCalibration | None:
    """Find the calibration of the set at `path` with images of `shape`; see `find_calibration`."""
    ids, setting = metadata.calibration_ids, setting_of(metadata, shape)
    return find_calibration(path, ids, setting, metadata.created_utc, given, way_out)


def setting_of(metadata: SetMetadata, shape: tuple[int, ...]) -> Setting:
    """Return the setting of a captured or imported set with images of `shape` (rows, columns)."""
    camera = metadata.camera
    is_known = camera is not None and camera.kind != "replay"
    return Setting(
        simulated=metadata.simulated,
        rig_name=metadata.rig_name,
        camera=f"{camera.kind} {camera.name}" if camera is not None and is_known else None,
        width_px=shape[1],
        height_px=shape[0],
        crop=metadata.crop,
        bit_depth=metadata.bit_depth,
        exposure_ms=None if camera is None else camera.exposure_ms,
        gain=None if camera is None else camera.gain,
        gamma=None if camera is None else camera.gamma,
        pixel_value_controls={} if camera is None else camera.pixel_value_controls,
        photograph_gamma=metadata.gamma,
        light_directions=metadata.lighting.directions,
        led_levels_percent=tuple(
            record.led_level_percent for record in metadata.images if record.light is not None
        ),
    )
