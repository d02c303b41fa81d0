"""Import of photographs as a captured set."""

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from classify import Lighting
from classify.errors import InputError
from classify.images.colour import linear_from_srgb, luminance
from classify.labels import checked_label
from rig.image_file import read_image
from rig.set_file import pixels_sha256

from .captured_set import CapturedSet
from .metadata import ImageRecord, LightingRecord, SetMetadata

Gamma = Literal["linear", "srgb"]


def import_images(
    paths: Sequence[Path],
    lighting: Lighting,
    *,
    gamma: Gamma | None = None,
    ambient: Path | None = None,
    label: str | None = None,
) -> CapturedSet:
    """Make a captured set from photographs: PNG, JPEG or TIFF, 8 or 16 bit, grey or colour.

    Linear grey images keep their pixel values. All others are made linear, reduced to luminance and
    stored with 16 bits. A pixel with any channel at full scale is stored at full scale, so that the
    solver treats it as saturated. An alpha channel is ignored.

    Parameters
    ----------
    paths
        One photograph per light, in the order of `lighting`.
    gamma
        Response of the photographs, ``linear`` (the default) or ``srgb``. It must be given for
        JPEG, which does not state it.
    ambient
        Photograph with all lights off.

    Raises
    ------
    InputError
        If a file is missing, damaged or of another format, sizes or depths differ, or `gamma` is
        missing for a JPEG.
    """
    if label is not None:
        checked_label(label)
    if len(paths) != len(lighting):
        raise InputError(f"{len(paths)} images for {len(lighting)} lights; give one image each")
    files = [*paths, *(() if ambient is None else (ambient,))]
    photographs = [read_image(path) for path in files]
    first = photographs[0]
    for path, photograph in zip(files[1:], photographs[1:], strict=True):
        if photograph.shape[:2] != first.shape[:2]:
            raise InputError(
                f"{path}: {_size(photograph)} px, but {files[0]} has {_size(first)} px; "
                "all images must show the same frame"
            )
        if photograph.dtype != first.dtype:
            raise InputError(
                f"{path}: {photograph.dtype}, but {files[0]} is {first.dtype}; "
                "all images must have the same depth"
            )
    if gamma is None and first.dtype == np.uint8:
        for path in files:
            if path.suffix.lower() in (".jpg", ".jpeg"):
                raise InputError(
                    f"{path}: a JPEG does not state its response; give --gamma srgb "
                    "(an ordinary camera) or --gamma linear"
                )
    if gamma == "srgb" or any(photograph.ndim == 3 for photograph in photographs):
        planes = [_linear_luminance(photograph, gamma == "srgb") for photograph in photographs]
        full_scale = 65535
    else:
        planes = [photograph.astype(np.uint16) for photograph in photographs]
        full_scale = int(np.iinfo(first.dtype).max)
    images = np.stack(planes[: len(lighting)])
    ambient_image = None if ambient is None else planes[-1]
    # Bytes of a file name that are not UTF-8 are escaped.
    names = [path.name.encode("utf-8", "backslashreplace").decode() for path in files]
    records = [ImageRecord(light=k, source_file=name) for k, name in enumerate(names)]
    if ambient is not None:
        records[-1] = ImageRecord(light=None, source_file=names[-1])
    metadata = SetMetadata(
        label=label,
        created_utc=datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
        simulated=False,
        bit_depth=8 * first.dtype.itemsize,
        full_scale=full_scale,
        lighting=LightingRecord.of(lighting),
        images=tuple(records),
        gamma=gamma or "linear",
        software_version=version("ps4rig"),
        pixels_sha256=pixels_sha256(images, ambient_image),
    )
    return CapturedSet(images, ambient_image, metadata)


def _linear_luminance(photograph: npt.NDArray[Any], srgb: bool) -> npt.NDArray[np.uint16]:
    top = np.iinfo(photograph.dtype).max
    levels = np.arange(top + 1, dtype=np.float32) / np.float32(top)
    if srgb:
        levels = linear_from_srgb(levels)
    linear = levels[photograph]
    saturated = photograph == top
    if photograph.ndim == 3:
        linear, saturated = luminance(linear), saturated.any(axis=2)
    stored: npt.NDArray[np.uint16] = np.rint(linear * np.float32(65535.0)).astype(np.uint16)
    stored[saturated] = 65535
    return stored


def _size(image: npt.NDArray[Any]) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"
