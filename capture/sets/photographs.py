"""Photographs of one set: read to linear values, and imported as a captured set."""

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np
import numpy.typing as npt

from capture.base.errors import SetRejected
from capture.base.utc_time import utc_text
from classify import Calibration, InputError, Lighting
from classify.base.arrays import Array, BoolArray, FloatMap
from classify.base.regular_file import read_regular_file
from classify.lights.algebra import require_solvable
from classify.methods import checked_label
from rig.image_file import read_image_file
from rig.image_metadata import ImageMetadata, linear_from_srgb, luminance
from rig.set_file import pixels_sha256

from .captured_set import CapturedSet
from .image_checks import CheckedImages, check_photographs
from .metadata import ImageRecord, LightingRecord, SetMetadata
from .photograph_warnings import file_warnings, import_warnings

Gamma = Literal["linear", "srgb"]
_GammaSource = Literal["stated", "given", "assumed"]  # by the files, by the user, by default
Crop = tuple[int, int, int, int]  # column and row of the top left pixel, width, height

EXPORTED_METADATA = "metadata.json"
"""Metadata of a set beside its images in a folder of `ps4rig export`."""
_MAX_METADATA_BYTES = 1 << 24

DNG = ".dng"
_SAMPLES = 64  # of colours, along each side of an image
# Depths of common sensors, from which that of a file of 16 bits is guessed.
_DEPTHS = (8, 10, 12, 14, 16)


@dataclass(frozen=True, eq=False)
class Photographs:
    """Photographs of one frame, linear in light."""

    planes: list[npt.NDArray[np.uint16]]  # (H, W) uint16 each
    colours: list[FloatMap]  # (n, 3) linear samples of each, NaN if saturated; empty if any is grey
    bit_depth: int
    full_scale: int  # saturated value in `planes`
    depth_guessed_from: int | None  # largest value in the files, if the depth was guessed from it
    gamma: Gamma  # of the files
    gamma_source: _GammaSource
    frame: tuple[int, int]  # rows and columns before the crop
    orientation: int  # EXIF orientation of the files; `planes` are upright
    capture_date: str | None
    exposures_ms: tuple[float, ...]  # those that the files state
    warnings: tuple[str, ...]  # about gamma, settings of the camera and orientation


def read_photographs(
    paths: Sequence[Path], *, gamma: Gamma | None, bits: int | None, crop: Crop | None
) -> Photographs:
    """Read photographs that belong together; parameters and errors as of `import_images`."""
    dng_count = sum(path.suffix.lower() == DNG for path in paths)
    if dng_count not in (0, len(paths)):
        raise InputError(
            f"{dng_count} of {len(paths)} photographs are DNG; give all or none as DNG"
        )
    if dng_count and (gamma == "srgb" or bits is not None):
        raise InputError("a DNG is linear and states its depth; leave out --gamma and --bits")
    frames, metadata = _read_alike(paths)
    stated = [file.response for file in metadata]
    gamma, source, warnings = _gamma_to_undo(paths, stated, frames[0], gamma)
    images = [_cropped(frame, crop) for frame in frames]
    if bits is None and gamma == "srgb" and source == "stated":
        bits = 8 * images[0].dtype.itemsize  # sRGB fills the depth of the file
    bit_depth, full_scale, largest = (16, 65535, None) if dng_count else _depth(images, bits)
    is_srgb = gamma == "srgb"
    is_colour = [image.ndim == 3 for image in images]
    colours = [_colours(image, full_scale, is_srgb) for image in images] if all(is_colour) else []
    if is_srgb or any(is_colour):
        planes = [_linear_luminance(image, full_scale, is_srgb) for image in images]
        full_scale = 65535
    else:
        planes = [image.astype(np.uint16) for image in images]
    rows, columns = frames[0].shape[:2]
    capture_date = next(filter(None, (file.capture_date for file in metadata)), None)
    return Photographs(
        planes, colours, bit_depth, full_scale, largest, gamma, source, (rows, columns),
        metadata[0].orientation, capture_date,
        tuple(file.exposure_ms for file in metadata if file.exposure_ms is not None),
        (*warnings, *file_warnings(metadata)),
    )  # fmt: skip


def _gamma_to_undo(
    paths: Sequence[Path], stated: Sequence[str | None], frame: Array, gamma: Gamma | None
) -> tuple[Gamma, _GammaSource, tuple[str, ...]]:
    """Return the gamma to undo, its source and warnings about it."""
    if gamma is not None:
        others = [k for k, other in enumerate(stated) if other not in (None, gamma)]
        if not others:
            return gamma, "given", ()
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        warning = (
            f"{paths[others[0]].name}{more}: the file states {stated[others[0]]}, but was read "
            f"with --gamma {gamma}"
        )
        return gamma, "given", (warning,)
    first = stated[0]
    for path, response in zip(paths, stated, strict=True):
        if response != first:
            raise InputError(
                f"{path}: states {response or 'no response'}, but {paths[0]} states "
                f"{first or 'none'}; give --gamma linear or --gamma srgb for all"
            )
        if response is None and path.suffix.lower() in (".jpg", ".jpeg"):
            raise InputError(
                f"{path}: this JPEG does not state its response; give --gamma srgb "
                "(an ordinary camera) or --gamma linear"
            )
    if first in get_args(Gamma):
        return cast(Gamma, first), "stated", ()
    if first is not None:
        raise InputError(
            f"{paths[0]}: states {first}; save it with a linear or sRGB response, or give "
            "--gamma linear or --gamma srgb to read it as that"
        )
    if frame.dtype != np.uint8 and frame.ndim == 2:
        return "linear", "assumed", ()
    kind = "have 8 bits" if frame.dtype == np.uint8 else "are in colour"
    warning = (
        f"the photographs {kind} and do not state their response: read as linear; --gamma srgb or "
        "--gamma linear states it"
    )
    return "linear", "assumed", (warning,)


def read_mask(
    path: Path, frame: tuple[int, int], crop: Crop | None, orientation: int | None = None
) -> BoolArray:
    """Read a mask of photographs with this frame, (rows, columns): true above mid-grey."""
    image, metadata = read_image_file(path)
    if orientation is not None and metadata.orientation not in (1, orientation):
        raise InputError(
            f"{path}: EXIF orientation {metadata.orientation}, but the photographs have "
            f"{orientation}; save the mask without EXIF data"
        )
    if image.shape[:2] != frame:
        raise InputError(
            f"{path}: {_size(image)} px, but the photographs have {frame[1]} x {frame[0]} px; "
            "a mask covers the same frame"
        )
    grey = image if image.ndim == 2 else image.max(axis=2)
    grey, white = _cropped(grey, crop), np.iinfo(image.dtype).max
    mask: BoolArray = np.asarray(grey > white // 2)
    if not mask.any():
        where = "everywhere" if crop is None else "in all of the crop"
        raise InputError(
            f"{path}: the mask is black {where}, with values up to {grey.max()} of {white}; white "
            "marks the part"
        )
    return mask


def _read_alike(paths: Sequence[Path]) -> tuple[list[Array], list[ImageMetadata]]:
    """Read images that must agree in size, depth and orientation."""
    files = [read_image_file(path) for path in paths]
    first, first_metadata = files[0]
    for path, (image, metadata) in zip(paths[1:], files[1:], strict=True):
        if metadata.orientation != first_metadata.orientation:
            raise InputError(
                f"{path}: EXIF orientation {metadata.orientation}, but {paths[0]} has "
                f"{first_metadata.orientation}; keep the camera fixed between photographs. A "
                "camera that looks down may record a wrong orientation: then remove the EXIF data "
                "of all images"
            )
        if image.shape[:2] != first.shape[:2]:
            raise InputError(
                f"{path}: {_size(image)} px, but {paths[0]} has {_size(first)} px; "
                "all images must show the same frame"
            )
        if image.dtype != first.dtype:
            raise InputError(
                f"{path}: {image.dtype}, but {paths[0]} is {first.dtype}; "
                "all images must have the same depth"
            )
    return [image for image, _ in files], [metadata for _, metadata in files]


def _cropped(image: Array, crop: Crop | None) -> Array:
    if crop is None:
        return image
    x, y, width, height = crop
    rows, columns = image.shape[:2]
    if min(x, y) < 0 or min(width, height) < 1 or x + width > columns or y + height > rows:
        raise InputError(
            f"--crop {x},{y},{width},{height}: not within {columns} x {rows} px; give column and "
            "row of the top left pixel, width and height"
        )
    return np.ascontiguousarray(image[y : y + height, x : x + width])


def _depth(images: Sequence[Array], bits: int | None) -> tuple[int, int, int | None]:
    """Depth of the data, saturation value, and largest value if depth was guessed."""
    file_bits = 8 * images[0].dtype.itemsize
    largest = max(int(image.max()) for image in images)
    used_bits = int(
        np.bitwise_or.reduce([np.bitwise_or.reduce(image, axis=None) for image in images])
    )
    guessed = bits is None and file_bits == 16
    bits = bits or (_guessed_depth(largest, used_bits) if guessed else file_bits)
    if not 1 <= bits <= file_bits:
        raise InputError(f"--bits {bits}: the files have {file_bits} bits")
    # Cameras write the data into the lower or the upper bits of a value.
    shift = 0 if largest < 1 << bits else file_bits - bits
    if used_bits & ((1 << shift) - 1):
        raise InputError(f"--bits {bits}: the value {largest} in the files has more bits")
    return bits, ((1 << bits) - 1) << shift, largest if guessed else None


def _guessed_depth(largest: int, used_bits: int) -> int:
    """Depth of data in 16 bits; `used_bits` are the bits that are set in some pixel."""
    trailing_zero_bits = max((used_bits & -used_bits).bit_length() - 1, 0)  # 0 if all black
    # Data in the upper bits use all of them; among few values the lower bits may be 0 by chance.
    if used_bits == (1 << 16) - (1 << trailing_zero_bits):
        return next(depth for depth in _DEPTHS if depth + trailing_zero_bits >= 16)
    return next(depth for depth in _DEPTHS if largest < 1 << depth)


def _linear(image: Array, full_scale: int, srgb: bool) -> FloatMap:
    levels = np.arange(np.iinfo(image.dtype).max + 1, dtype=np.float32) / np.float32(full_scale)
    levels = np.minimum(levels, np.float32(1.0))
    if srgb:
        levels = linear_from_srgb(levels)
    return np.asarray(levels[image], np.float32)


def _colours(image: Array, full_scale: int, srgb: bool) -> FloatMap:
    """(n, 3) linear colours of pixels on a grid, NaN if saturated."""
    row_step, column_step = (max(1, side // _SAMPLES) for side in image.shape[:2])
    samples = image[::row_step, ::column_step].reshape(-1, 3)
    colours = _linear(samples, full_scale, srgb)
    colours[(samples >= full_scale).any(axis=1)] = np.nan
    return colours


def _linear_luminance(image: Array, full_scale: int, srgb: bool) -> npt.NDArray[np.uint16]:
    linear = _linear(image, full_scale, srgb)
    is_colour = image.ndim == 3
    brightest = image.max(axis=2) if is_colour else image
    luminances = luminance(linear) if is_colour else linear
    stored: npt.NDArray[np.uint16] = np.rint(luminances * np.float32(65535.0)).astype(np.uint16)
    stored[brightest >= full_scale] = 65535
    return stored


def _size(image: Array) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"


def import_images(
    paths: Sequence[Path],
    lighting: Lighting,
    *,
    gamma: Gamma | None = None,
    ambient: Path | None = None,
    label: str | None = None,
    bits: int | None = None,
    mask: Path | None = None,
    crop: Crop | None = None,
    accept: Collection[str] = (),
    warnings: Sequence[str] = (),
    calibration: Calibration | None = None,
) -> CapturedSet:
    """Make a captured set from PNG, JPEG, TIFF, TGA or DNG photographs of 8 or 16 bit.

    The photographs are rotated upright by their EXIF data. Linear grey images keep their pixel
    values. All others are made linear, reduced to luminance and stored with 16 bits. A pixel with
    any channel at full scale is stored at full scale, so that the solver treats it as saturated. An
    alpha channel is ignored. `check_photographs` checks the images.

    Parameters
    ----------
    paths
        One photograph per light, in the order of `lighting`.
    gamma
        Response of the photographs, ``linear`` or ``srgb``. By default it is the one that they
        state, else ``linear``; it must be given for a JPEG that does not state it.
    ambient
        Photograph with all lights off.
    bits
        Depth of the data in the files; guessed from the largest value for files of 16 bits.
    mask
        Image of the same frame, light where the part is. No other pixel is valid.
    crop
        Column and row of the top left pixel, width and height of the part that is kept.
    accept
        Values of `ImportCause` that give a warning instead of a refusal.
    warnings
        Warnings about the lights, to be kept in the set before those of the checks.
    calibration
        Of camera and lights, which the checks take into account.

    Raises
    ------
    InputError
        If a file is missing, damaged or of another format, sizes, depths or orientations differ,
        `gamma` is missing although it is unknown, or images under these lights cannot be solved.
    SetRejected
        If no surface explains the photographs; the message names every cause.
    """
    if label is not None:
        checked_label(label)
    if len(paths) != len(lighting):
        raise InputError(
            f"{len(paths)} images for {len(lighting)} lights; give one image each, in a file of "
            "its own, and the lights of these images by --tilts or --lights"
        )
    require_solvable(lighting)
    files = [*paths, *(() if ambient is None else (ambient,))]
    photographs = read_photographs(files, gamma=gamma, bits=bits, crop=crop)
    part_mask = (
        None if mask is None else read_mask(mask, photographs.frame, crop, photographs.orientation)
    )
    images = np.stack(photographs.planes[: len(lighting)])
    ambient_image = None if ambient is None else photographs.planes[-1]
    names = [_escaped_name(path) for path in files]
    light_images = CheckedImages(
        images=images,
        ambient=np.zeros_like(images[0]) if ambient_image is None else ambient_image,
        later_ambient=None,
        lighting=lighting,
        names=names[: len(lighting)],
        full_scale=photographs.full_scale,
        noise=None,
    )
    findings, checks = check_photographs(
        light_images, part_mask, (calibration or Calibration()).at(None)
    )
    refused = [finding for finding in findings if finding.refutes and finding.cause not in accept]
    if refused:
        causes = "; ".join(f"{finding.text} (--accept {finding.cause})" for finding in refused)
        raise SetRejected(f"set rejected: {causes}")
    records = [ImageRecord(light=k, source_file=name) for k, name in enumerate(names)]
    if ambient is not None:
        records[-1] = ImageRecord(light=None, source_file=names[-1])
    metadata = SetMetadata(
        label=label,
        created_utc=utc_text(),
        simulated=any(map(_is_simulated, {path.parent for path in paths})),
        bit_depth=photographs.bit_depth,
        full_scale=photographs.full_scale,
        lighting=LightingRecord.of(lighting),
        images=tuple(records),
        checks=checks,
        gamma=photographs.gamma,
        gamma_source=photographs.gamma_source,
        photographed=photographs.capture_date,
        crop=crop,
        mask_file=None if mask is None else _escaped_name(mask),
        warnings=(
            *warnings,
            *photographs.warnings,
            *import_warnings(photographs, lighting, mask, part_mask),
            *(finding.text for finding in findings),
        ),
        accepted=tuple(dict.fromkeys(finding.cause for finding in findings if finding.refutes)),
        software_version=version("ps4rig"),
        pixels_sha256=pixels_sha256(images, ambient_image, part_mask),
    )
    return CapturedSet(images, ambient_image, metadata, part_mask)


def _escaped_name(path: Path) -> str:
    """Name of a file, with escapes for bytes that are not UTF-8."""
    return path.name.encode("utf-8", "backslashreplace").decode()


def _is_simulated(folder: Path) -> bool:
    """Whether `ps4rig export` wrote the images of a folder from a simulated set."""
    try:
        text = read_regular_file(folder / EXPORTED_METADATA, _MAX_METADATA_BYTES)
        exported = json.loads(text)
    except (InputError, ValueError, RecursionError):
        return False
    return isinstance(exported, dict) and exported.get("simulated") is True
