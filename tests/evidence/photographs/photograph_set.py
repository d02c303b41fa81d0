"""Photographs of one object under known lights, and picks of four lights near a ring."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import (
    AliasChoices,
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    ValidationError,
)

from capture.sets.light_list import light_list_text, listed_files
from capture.sets.photographs import read_mask, read_photographs
from classify import Lighting
from classify.base.errors import InputError
from classify.lighting import light_fault, light_vectors

LIGHTS_FILE = "lights.json"
MASK_FILE = "mask.png"
REFERENCE_FILE = "reference_height_mm.npy"
# Tilt of the first light and slant of the rings that picks are near to.
_RING_TILTS_DEG = tuple(range(0, 90, 15))
_RING_SLANTS_DEG = tuple(range(25, 65, 5))
_FARTHEST_DEG = 20.0  # of a light from its place on the ring
_MOST_PICKS = 3
_MOST_SHARED_LIGHTS = 2  # of two picks
_DARK = 0.02  # of the brightest pixels, below which a median pixel is background without a mask
_MARGIN_PX = 8  # around the object; edges of a mask are not exact

Pick = tuple[int, ...]


class _Light(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")
    file: str
    direction: tuple[FiniteFloat, FiniteFloat, FiniteFloat]
    intensity: float | None = Field(
        default=None,
        gt=0.0,
        allow_inf_nan=False,
        validation_alias=AliasChoices("intensity", "relative_intensity_estimated"),
    )


class _Notes(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")
    images: tuple[_Light, ...]
    ambient: str | None = None
    mm_per_pixel: float | None = Field(default=None, gt=0.0)


@dataclass(frozen=True, eq=False)
class PhotographSet:
    """Photographs of one object, cut to it.

    Attributes
    ----------
    name
        Name of the folder.
    images, ambient, full_scale
        (N, H, W) photographs, (H, W) photograph with all lights off if there is one, and the value
        at which they saturate.
    directions
        (N, 3) unit vectors towards the lights.
    intensities
        (N,) relative intensities of the lights; None if they are not known.
    mask
        (H, W) bool, the pixels of the object.
    reference_p
        (H, W) slope dz/dx of a height measured by other means; None if there is none.
    warnings
        Lights that were left out.
    """

    name: str
    images: npt.NDArray[Any]
    ambient: npt.NDArray[Any] | None
    full_scale: float
    directions: npt.NDArray[np.float64]
    intensities: npt.NDArray[np.float64] | None
    mask: npt.NDArray[np.bool_]
    reference_p: npt.NDArray[np.float32] | None
    warnings: Sequence[str] = ()

    def lighting_of(self, pick: Pick) -> Lighting:
        """The lights of a pick."""
        chosen = list(pick)
        known = np.empty(0) if self.intensities is None else self.intensities[chosen]
        return Lighting(self.directions[chosen], known)

    def rotated(self) -> PhotographSet:
        """The same object with its lights, both rotated by 90 degrees anticlockwise."""
        x, y, z = self.directions.T
        return self._moved(lambda image: np.rot90(image, axes=(-2, -1)), (-y, x, z))

    def mirrored(self) -> PhotographSet:
        """The same object with its lights, left and right exchanged."""
        x, y, z = self.directions.T
        return self._moved(lambda image: image[..., ::-1], (-x, y, z))

    def patch(self, top: int, left: int, side_px: int) -> PhotographSet:
        """A square of the photographs, under the same lights."""
        square = np.s_[..., top : top + side_px, left : left + side_px]
        x, y, z = self.directions.T
        return self._moved(lambda image: image[square], (x, y, z))

    def _moved(
        self, move: Callable[[npt.NDArray[Any]], npt.NDArray[Any]], directions: tuple[Any, ...]
    ) -> PhotographSet:
        """Move images, lights and mask alike."""
        return replace(
            self,
            images=np.ascontiguousarray(move(self.images)),
            ambient=None if self.ambient is None else np.ascontiguousarray(move(self.ambient)),
            directions=np.stack(directions, axis=1),
            mask=move(self.mask),
            reference_p=None,
        )

    def picks(self) -> list[Pick]:
        """Up to three picks of four lights near a ring, nearest first; two share two lights."""
        found: dict[Pick, float] = {}
        for tilt_deg, slant_deg in itertools.product(_RING_TILTS_DEG, _RING_SLANTS_DEG):
            ring = light_vectors(np.arange(4) * 90.0 + tilt_deg, float(slant_deg))
            cosines = np.clip(ring @ self.directions.T, -1.0, 1.0)
            nearest = tuple(map(int, cosines.argmax(axis=1)))
            farthest_deg = float(np.degrees(np.arccos(cosines.max(axis=1).min())))
            if len(set(nearest)) == 4 and farthest_deg <= _FARTHEST_DEG:
                found[nearest] = min(farthest_deg, found.get(nearest, np.inf))
        chosen: list[Pick] = []
        for pick in sorted(found, key=lambda each: (found[each], each)):
            if all(len(set(pick) & set(other)) <= _MOST_SHARED_LIGHTS for other in chosen):
                chosen.append(pick)
        return chosen[:_MOST_PICKS]


def photograph_folders(folder: Path) -> list[Path]:
    """The folders in `folder` that hold photographs with their lights.

    Raises
    ------
    InputError
        If there is none.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give one that holds folders of photographs")
    found = [path for path in sorted(folder.iterdir()) if (path / LIGHTS_FILE).is_file()]
    if not found:
        raise InputError(f"{folder}: holds no folder of photographs with {LIGHTS_FILE}")
    return found


def load_photographs(folder: Path) -> PhotographSet:
    """Read a folder: photographs, `lights.json`, and if there are, a mask and a reference height.

    A light that cannot be, such as one below the horizon, is left out with a warning.

    `lights.json` has ``images``, a list of ``{"file": name, "direction": [x, y, z]}`` with an
    ``intensity`` if known, and may have the name of an ``ambient`` photograph and ``mm_per_pixel``.
    Pixel values are taken as linear. Without `mask.png`, the object is where the median photograph
    exceeds 2 % of the brightest. `reference_height_mm.npy` is a height measured by other means,
    (H, W) in millimetres.

    Raises
    ------
    InputError
        If a file is missing, damaged or of another form, no pixel shows an object, or no four
        lights are near a ring.
    """
    notes, lights, warnings = _read_notes(folder / LIGHTS_FILE), [], []
    for number, light in enumerate(notes.images):
        if fault := light_fault(light.direction, light.intensity or 1.0):
            place = f"{folder / LIGHTS_FILE}: image {number}, {light.file}"
            warnings.append(f"{place}, is left out: the light {fault}")
        else:
            lights.append(light)
    lighting = Lighting(np.array([light.direction for light in lights]))
    known = [light.intensity for light in lights if light.intensity is not None]
    names = [light.file for light in lights] + ([notes.ambient] if notes.ambient else [])
    paths = listed_files(folder / LIGHTS_FILE, [name.replace("\\", "/") for name in names])
    read = read_photographs(paths, gamma="linear", bits=None, crop=None)
    images = np.stack(read.planes[: len(lighting)])
    ambient = read.planes[-1] if notes.ambient else None
    if (folder / MASK_FILE).is_file():
        mask = read_mask(folder / MASK_FILE, read.frame, None, read.orientation)
    else:
        mask = np.median(images, axis=0) > _DARK * np.quantile(images, 0.99)
    if not mask.any():
        raise InputError(f"{folder}: no pixel is brighter than the background; give {MASK_FILE}")
    rows, columns = np.nonzero(mask.any(axis=1))[0], np.nonzero(mask.any(axis=0))[0]
    part = tuple(
        slice(max(int(each[0]) - _MARGIN_PX, 0), int(each[-1]) + 1 + _MARGIN_PX)
        for each in (rows, columns)
    )
    reference_p = _reference_p(folder, notes, mask.shape)
    found = PhotographSet(
        folder.name,
        np.ascontiguousarray(images[:, *part]),
        None if ambient is None else np.ascontiguousarray(ambient[part]),
        float(read.full_scale),
        lighting.directions,
        np.array(known) if len(known) == len(lighting) else None,
        mask[part],
        None if reference_p is None else reference_p[part],
        warnings,
    )
    if not found.picks():
        raise InputError(
            f"{folder}: no four of its {len(lighting)} lights are within {_FARTHEST_DEG:g} degrees "
            "of a ring; leave the folder out"
        )
    return found


def _read_notes(path: Path) -> _Notes:
    try:
        return _Notes.model_validate_json(light_list_text(path))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the file"
        raise InputError(f"{path}: {where}: {first['msg']}") from error


def _reference_p(
    folder: Path, notes: _Notes, shape: tuple[int, ...]
) -> npt.NDArray[np.float32] | None:
    path = folder / REFERENCE_FILE
    if not path.is_file() or notes.mm_per_pixel is None:
        return None
    try:
        height_mm = np.load(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not an array of NumPy ({error})") from error
    if height_mm.shape != shape:
        raise InputError(f"{path}: has shape {height_mm.shape}, the photographs have {shape}")
    return np.asarray(np.gradient(height_mm, axis=1) / notes.mm_per_pixel, np.float32)
