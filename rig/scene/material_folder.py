"""Material folders: a surface as height.png, normal.png and albedo.png.

| file | what it holds |
|---|---|
| `height.png` | 8 or 16 bit, white is high |
| `normal.png`, `.jpg` or `.jpeg` | OpenGL convention: red x right, green y up, blue to the viewer |
| `albedo.png`, `.jpg` or `.jpeg` | sRGB, colour or grey |
| `material.json` | `size_mm` (width of the tile) and `relief_mm` (black to white of the height) |
| `meta.json` | without known sizes: `height.scale_px_per_unit`, pixels from black to white |

A height or a normal map is required; the other files are optional.
"""

from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, ValidationError

from classify.base.arrays import FloatMap
from classify.base.errors import InputError
from classify.base.models import first_fault
from classify.base.regular_file import read_regular_file
from rig.image_metadata import linear_from_srgb, luminance

from .surfaces import (
    MAX_SIDE_PX,
    PeriodicSurface,
    periodic_height,
    rms_slope,
    spectral_gradients,
)

_DEFAULT_ALBEDO = 0.8  # of a material without an albedo map
_DEFAULT_RMS_SLOPE = 0.30  # of a height of unknown relief; scanned materials have 0.1 to 0.9
_MAX_SLOPE = 10.0  # 84 degrees; one step of an 8-bit normal map changes this slope by 8 %
_MAX_JSON_BYTES = 1 << 20
# y points down if the curl of the slopes is then this many times smaller. For normal maps of 8 bits
# of twelve surfaces it is then 15 times larger or more.
_CLEARLY_LESS = 2.0
_MAP_ENDINGS = ("png", "jpg", "jpeg")


class _Notes(BaseModel):
    """Fields read from a JSON file, which may have more, such as a name or a licence."""

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True, allow_inf_nan=False)


class _MaterialNotes(_Notes):
    size_mm: PositiveFloat | None = None
    relief_mm: PositiveFloat | None = None


class _HeightNotes(_Notes):
    scale_px_per_unit: Annotated[float, Field(gt=0.0, lt=1e6)] | None = None


class _MetaNotes(_Notes):
    height: _HeightNotes = _HeightNotes()


_AnyNotes = TypeVar("_AnyNotes", bound=_Notes)


def bundled_materials() -> dict[str, Path]:
    """The material folders of the package, by name."""
    materials = Path(__file__).parent / "materials"
    return {folder.name: folder for folder in sorted(materials.iterdir()) if folder.is_dir()}


def load_material(folder: str | Path) -> PeriodicSurface:
    """Read a material folder as one period of a surface."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such material folder")
    height_file = _only_file(folder, "height", ("png",))
    normal_file = _only_file(folder, "normal", _MAP_ENDINGS)
    albedo_file = _only_file(folder, "albedo", _MAP_ENDINGS)
    if normal_file is None and height_file is None:
        raise InputError(
            f"{folder}: no height.png and no normal.png or normal.jpg; a material needs one of them"
        )
    maps = {file: _read(file) for file in (normal_file, height_file, albedo_file) if file}
    first_file, *_ = maps
    shape = maps[first_file].shape[:2]
    for file, image in maps.items():
        if image.shape[:2] != shape:
            raise InputError(
                f"{file}: {image.shape[1]} x {image.shape[0]} px, but {first_file.name} has "
                f"{shape[1]} x {shape[0]}; the maps of a material must be of one size"
            )
    albedo = (
        luminance(linear_from_srgb(maps[albedo_file]))
        if albedo_file
        else np.full(shape, _DEFAULT_ALBEDO)
    )
    levels = maps[height_file].mean(axis=2) if height_file else None  # 0 black to 1 white
    scale = _known_scale(folder, width_px=shape[1])
    if normal_file:
        p, q = _slopes(maps[normal_file], normal_file)
        _require_y_up(p, q, normal_file)
        if levels is None or np.ptp(levels) == 0.0:
            surface = PeriodicSurface(periodic_height(p, q), p, q, albedo, folder.name)
        else:
            scale = scale or _fitted_scale(levels, p, q, folder)
            surface = PeriodicSurface(levels * scale, p, q, albedo, folder.name)
    elif levels is not None:
        scale = scale or _default_scale(levels)
        surface = PeriodicSurface.from_height(levels * scale, albedo, folder.name)
    return surface.band_limited()


def _only_file(folder: Path, stem: str, endings: tuple[str, ...]) -> Path | None:
    files = [folder / f"{stem}.{end}" for end in endings if (folder / f"{stem}.{end}").is_file()]
    if len(files) > 1:
        names = " and ".join(file.name for file in files)
        raise InputError(f"{folder}: {names} are both there; remove one of them")
    return files[0] if files else None


def _read(file: Path) -> FloatMap:
    """Read an image as (H, W, 3) float32 in R, G, B, within 0 to 1."""
    # Imported here because most rigs never need the decoders.
    from rig.image_file import read_image_file

    image, _ = read_image_file(file)
    if image.ndim == 2:
        image = np.dstack([image] * 3)
    if not all(8 <= side <= MAX_SIDE_PX for side in image.shape[:2]):
        raise InputError(
            f"{file}: {image.shape[1]} x {image.shape[0]} px; the sides of a material must be "
            f"8 to {MAX_SIDE_PX} px"
        )
    white = np.float32(255.0 if image.dtype == np.uint8 else 65535.0)
    return np.asarray(image / white, np.float32)


def _slopes(rgb: FloatMap, file: Path) -> tuple[FloatMap, FloatMap]:
    """Slopes p and q of a normal map."""
    x, y, z = np.moveaxis(2.0 * rgb - 1.0, -1, 0)
    if np.median(z) <= 0.0:
        raise InputError(
            f"{file}: most normals point away from the viewer; give a tangent-space normal map "
            "(mostly blue), OpenGL convention"
        )
    # Slopes are limited to _MAX_SLOPE and keep their direction, also where z is 0 or negative.
    z = np.maximum(z, 1e-3)
    steepness = np.hypot(x, y) / z
    factor = np.minimum(1.0, _MAX_SLOPE / np.maximum(steepness, 1e-9)) / z
    return np.asarray(-x * factor, np.float32), np.asarray(-y * factor, np.float32)


def _require_y_up(p: FloatMap, q: FloatMap, file: Path) -> None:
    """Refuse slopes that are those of a surface only with y pointing down."""
    p_upwards = np.roll(p, 1, axis=0) - np.roll(p, -1, axis=0)
    q_to_the_right = np.roll(q, -1, axis=1) - np.roll(q, 1, axis=1)
    curl, curl_of_y_down = (
        float(np.mean(np.square(p_upwards - sign * q_to_the_right))) for sign in (1.0, -1.0)
    )
    if _CLEARLY_LESS * curl_of_y_down < curl:
        raise InputError(
            f"{file}: the normals fit a surface with y pointing down (DirectX); give the map of "
            "the OpenGL convention, or invert its green channel"
        )


def _fitted_scale(
    levels: npt.NDArray[np.floating], p: FloatMap, q: FloatMap, folder: Path
) -> float:
    """Pixels of height from black to white, fitted to p and q by least squares."""
    unit_p, unit_q = spectral_gradients(np.asarray(levels, np.float32))
    slope = rms_slope(unit_p, unit_q)
    scale = float(np.mean(unit_p * p + unit_q * q)) / slope**2 if slope > 0.0 else 0.0
    if scale <= 0.0:
        raise InputError(
            f"{folder}: height.png falls where the normal map rises; white is high and green is "
            "up (OpenGL). Correct one, or remove height.png to use the normals alone"
        )
    return scale


def _default_scale(levels: npt.NDArray[np.floating]) -> float:
    slope = rms_slope(*spectral_gradients(np.asarray(levels, np.float32)))
    return _DEFAULT_RMS_SLOPE / slope if slope > 0.0 else 1.0


def _known_scale(folder: Path, width_px: int) -> float | None:
    """Pixels of height from black to white, from `material.json` or else `meta.json`."""
    notes = _read_notes(folder / "material.json", _MaterialNotes)
    if notes is not None and notes.size_mm and notes.relief_mm:
        return notes.relief_mm / notes.size_mm * width_px
    meta = _read_notes(folder / "meta.json", _MetaNotes)
    return None if meta is None else meta.height.scale_px_per_unit


def _read_notes(file: Path, model: type[_AnyNotes]) -> _AnyNotes | None:
    """Read a JSON file; None without one."""
    if not file.is_file():
        return None
    try:
        return model.model_validate_json(read_regular_file(file, _MAX_JSON_BYTES))
    except ValidationError as error:
        raise InputError(f"{file}: {first_fault(error)}") from error
