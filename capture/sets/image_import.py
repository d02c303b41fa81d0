"""Plain photographs into a captured set."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt
import tifffile

from classify import Lighting
from classify.errors import InputError
from classify.images.colour import linear_from_srgb, luminance
from classify.labels import checked_label
from rig.set_file import pixels_sha256

from .captured_set import CapturedSet
from .metadata import ImageRecord, LightingRecord, SetMetadata

__all__ = ["Gamma", "import_images"]

Gamma = Literal["linear", "srgb"]
_MAX_BYTES = 2 * 2**30
_MAX_SIDE_PX = 32768
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def import_images(
    paths: Sequence[Path],
    lighting: Lighting,
    *,
    gamma: Gamma | None = None,
    ambient: Path | None = None,
    label: str | None = None,
) -> CapturedSet:
    """PNG, JPEG or TIFF, 8 or 16 bit, grey or colour, one per light.

    Grey images that are linear keep their pixel values. All others are made linear, reduced to
    luminance and stored with 16 bits; a pixel with any channel at full scale is stored at full
    scale, so that the solver knows it as saturated. An alpha channel is ignored.

    Parameters
    ----------
    paths
        In the order of `lighting`.
    gamma
        ``linear`` or ``srgb`` response. An 8-bit JPEG does not tell, so there it must be given;
        elsewhere the default is linear.
    ambient
        Photograph with all lights out.

    Raises
    ------
    InputError
        If a file is missing, damaged or of another kind, sizes or depths differ, or the response
        of a JPEG is not stated.
    """
    if label is not None:
        checked_label(label)
    if len(paths) != len(lighting):
        raise InputError(f"{len(paths)} images for {len(lighting)} lights; give one image each")
    files = [*paths, *(() if ambient is None else (ambient,))]
    photographs = [_read(path) for path in files]
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
                    f"{path}: a JPEG does not say how brightness was coded; give --gamma srgb "
                    "(an ordinary camera) or --gamma linear"
                )
    full_scale = 255 if first.dtype == np.uint8 else 65535
    if gamma == "srgb" or any(photograph.ndim == 3 for photograph in photographs):
        planes = [_linear_luminance(photograph, gamma == "srgb") for photograph in photographs]
        full_scale = 65535
    else:
        planes = [photograph.astype(np.uint16) for photograph in photographs]
    images = np.stack(planes[: len(lighting)])
    dark = None if ambient is None else planes[-1]
    records = [
        ImageRecord(light=light, source_file=_text(path.name)) for light, path in enumerate(paths)
    ]
    if ambient is not None:
        records.append(ImageRecord(light=None, source_file=_text(ambient.name)))
    metadata = SetMetadata(
        label=label,
        created_utc=datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
        simulated=False,
        bit_depth=8 if first.dtype == np.uint8 else 16,
        full_scale=full_scale,
        lighting=LightingRecord.of(lighting),
        images=tuple(records),
        gamma=gamma or "linear",
        software_version=version("ps4rig"),
        pixels_sha256=pixels_sha256(images, dark),
    )
    return CapturedSet(images, dark, metadata)


def _read(path: Path) -> npt.NDArray[Any]:
    """(H, W) or (H, W, 3 RGB), uint8 or uint16."""
    kind = path.suffix.lower()
    if kind not in (".png", ".jpg", ".jpeg", ".tif", ".tiff"):
        raise InputError(f"{path}: images come as PNG, JPEG or TIFF")
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path}: larger than {_MAX_BYTES} bytes")
        image = _decoded_tiff(path) if kind.startswith(".tif") else _decoded(path, kind)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: {image.dtype} pixels; give 8 or 16 bit")
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (3, 4)):
        raise InputError(f"{path}: {image.shape} is not one grey or colour image")
    if max(image.shape[:2]) > _MAX_SIDE_PX:
        raise InputError(f"{path}: {_size(image)} px; sides up to {_MAX_SIDE_PX} are handled")
    return image[:, :, :3] if image.ndim == 3 else image


def _decoded(path: Path, kind: str) -> npt.NDArray[Any]:
    content = path.read_bytes()
    # OpenCV fills what is missing of a truncated file with grey and says nothing.
    whole = _whole_png(content) if kind == ".png" else b"\xff\xd9" in content[-4096:]
    image = None
    if whole:
        # OpenCV raises for more pixels than it handles.
        with suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(
            f"{path}: not a complete {kind[1:].upper()} image, or too large; it may be truncated"
        )
    return np.ascontiguousarray(image[:, :, 2::-1]) if image.ndim == 3 else image


def _whole_png(content: bytes) -> bool:
    """Whether all chunks up to the last are there, each with the right checksum."""
    start = len(_PNG_SIGNATURE)
    if content[:start] != _PNG_SIGNATURE:
        return False
    while len(content) >= start + 12:
        end = start + 8 + int.from_bytes(content[start : start + 4], "big")
        if content[end : end + 4] != zlib.crc32(content[start + 4 : end]).to_bytes(4, "big"):
            return False
        if content[start + 4 : start + 8] == b"IEND":
            return True
        start = end + 4
    return False


def _decoded_tiff(path: Path) -> npt.NDArray[Any]:
    try:
        with tifffile.TiffFile(path) as tiff:
            photometric = tiff.pages.first.photometric
            if photometric not in (tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB):
                raise InputError(
                    f"{path}: TIFF pixels are {tifffile.PHOTOMETRIC(photometric).name}; save it as "
                    "grey or RGB"
                )
            if tiff.pages.first.compression != tifffile.COMPRESSION.LZW:
                return tiff.asarray()
        # LZW, which OpenCV writes by default, tifffile reads only with a further package.
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if image is None:
            raise InputError(f"{path}: not a complete TIFF image; it may be truncated")
        return np.ascontiguousarray(image[:, :, 2::-1]) if image.ndim == 3 else image
    except (FileNotFoundError, InputError):
        raise
    # What tifffile raises on damaged files depends on where the damage is.
    except Exception as error:
        raise InputError(
            f"{path}: not a readable TIFF ({error}); it may be truncated, or its compression not "
            "be handled"
        ) from error


def _linear_luminance(photograph: npt.NDArray[Any], srgb: bool) -> npt.NDArray[np.uint16]:
    top = np.iinfo(photograph.dtype).max
    levels = np.arange(top + 1, dtype=np.float32) / np.float32(top)
    if srgb:
        levels = linear_from_srgb(levels)
    linear = levels[photograph]
    if photograph.ndim == 3:
        saturated = (photograph == top).any(axis=2)
        linear = luminance(linear)
    else:
        saturated = photograph == top
    stored: npt.NDArray[np.uint16] = np.rint(linear * np.float32(65535.0)).astype(np.uint16)
    stored[saturated] = 65535
    return stored


def _text(name: str) -> str:
    """A file name, whose bytes need not be text, as text."""
    return name.encode("utf-8", "backslashreplace").decode("utf-8")


def _size(image: npt.NDArray[Any]) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"
