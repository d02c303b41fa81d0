"""The setting of a captured set, and the calibration that holds for it."""

from pathlib import Path

from capture.calibration.lookup import FoundCalibration, find_calibration
from capture.calibration.setting import Setting

from .metadata import SetMetadata

_OF_THE_CAMERA = {"exposure_ms", "gain", "gamma", "pixel_value_controls"}


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
    stated = {} if camera is None else camera.model_dump(include=_OF_THE_CAMERA)
    name = None if camera is None or camera.kind == "replay" else f"{camera.kind} {camera.name}"
    lit = [record for record in metadata.images if record.light is not None]
    return Setting(
        camera=name, width_px=shape[1], height_px=shape[0], photograph_gamma=metadata.gamma,
        light_directions=metadata.lighting.directions,
        led_levels_percent=tuple(record.led_level_percent for record in lit),
        **metadata.model_dump(include={"simulated", "rig_name", "crop", "bit_depth"}),
        **({"exposure_ms": None} | stated),
    )  # fmt: skip
