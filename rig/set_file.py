"""The file of a captured set: 16-bit pages, and metadata as JSON in the OME-XML.

`capture` writes and solves these files; a camera of `rig` replays them.
"""

import hashlib
import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import tifffile

from classify.base.arrays import BoolArray
from classify.base.errors import InputError
from classify.base.regular_file import open_regular_file

SCHEMA_VERSION = 6
NAMESPACE = "ps4rig/captured-set"
Planes = npt.NDArray[np.uint16]
# XPath of the metadata, in any OME schema.
_METADATA_PATH = f".//{{*}}CommentAnnotation[@Namespace='{NAMESPACE}']/{{*}}Value"
# These limits bound memory before pixels are read: a file of 255 lights of 32 megapixels.
_MAX_BYTES = 2**34
_MAX_DESCRIPTION_BYTES = 2**24
_MAX_PAGES = 256
_MAX_SIDE_PX = 32768


class OtherVersionError(InputError):
    """A captured set of another schema version."""


def read_set_file(path: Path) -> tuple[Planes, dict[str, Any]]:
    """Read the pages (light images, ambient image, mask) and the metadata fields; check hashes."""
    with opened_tiff(path) as tiff:
        fields, shape = _header(tiff, path)
        planes = np.empty(shape, np.uint16)
        for page, plane in zip(tiff.pages, planes, strict=True):
            page.asarray(out=plane)
    if pixels_sha256(planes) != fields.get("pixels_sha256"):
        raise InputError(
            f"{path}: the pixels do not match their SHA-256; the file was changed or damaged "
            "after it was captured, use the original"
        )
    return planes, fields


def read_set_header(path: Path) -> tuple[dict[str, Any], tuple[int, int, int]]:
    """Read the metadata fields and (pages, H, W), but no pixel. Errors as `read_set_file`."""
    with opened_tiff(path) as tiff:
        return _header(tiff, path)


def pixels_sha256(
    images: Planes, ambient: Planes | None = None, mask: BoolArray | None = None
) -> str:
    """SHA-256 of all pixels, in the order of the pages, as little-endian 16-bit rows."""
    digest = hashlib.sha256()
    for plane in pages(images, ambient, mask):
        hash_page(digest, plane)
    return digest.hexdigest()


def hash_page(digest: "hashlib._Hash", plane: Planes) -> None:
    """Add one page to the hash of `pixels_sha256`."""
    digest.update(np.ascontiguousarray(plane, dtype="<u2").data)


def pages(images: Planes, ambient: Planes | None, mask: BoolArray | None) -> list[Planes]:
    """Return the pages of a file; a mask is 65535 inside and 0 outside."""
    ambient_pages = [] if ambient is None else [ambient]
    mask_pages = [] if mask is None else [np.where(mask, np.uint16(65535), np.uint16(0))]
    return [*images, *ambient_pages, *mask_pages]


def fields_sha256(fields: dict[str, Any]) -> str:
    """SHA-256 of the fields without `sha256`, as sorted ASCII JSON without blanks."""
    hashed = {name: value for name, value in fields.items() if name != "sha256"}
    canonical = json.dumps(hashed, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode("ascii")).hexdigest()


@contextmanager
def opened_tiff(path: Path) -> Iterator[tifffile.TiffFile]:
    """Open a TIFF of bounded size; any error in reading it becomes an `InputError`."""
    with open_regular_file(path, _MAX_BYTES) as file:
        try:
            with tifffile.TiffFile(file) as tiff:
                tiff.pages.cache = True  # else each loop over the pages parses them again
                yield tiff
        except InputError:
            raise
        # Which exception tifffile raises for a damaged file depends on where the damage is.
        except Exception as error:
            raise InputError(
                f"{path}: not a readable TIFF ({error}); it may be truncated"
            ) from error


def _header(tiff: tifffile.TiffFile, path: Path) -> tuple[dict[str, Any], tuple[int, int, int]]:
    fields = _fields(tiff, path)
    count = len(tiff.pages)
    if count > _MAX_PAGES:
        raise InputError(f"{path}: holds {count} images; up to {_MAX_PAGES} are handled")
    if any(page.compression != tifffile.COMPRESSION.NONE for page in tiff.pages):
        raise InputError(f"{path}: its pages are compressed; a captured set is uncompressed")
    shapes = {(page.shape, str(page.dtype)) for page in tiff.pages}
    shape, dtype = next(iter(shapes))
    if len(shapes) > 1 or dtype != "uint16" or len(shape) != 2 or max(shape) > _MAX_SIDE_PX:
        raise InputError(f"{path}: its pages are not grey 16-bit images of one size")
    rows, columns = shape
    # Strips may point at the same bytes, so that a small file declares gigabytes.
    if 2 * count * rows * columns > tiff.filehandle.size:
        raise InputError(f"{path}: declares more pixels than it holds; it may be truncated")
    return fields, (count, rows, columns)


def _fields(tiff: tifffile.TiffFile, path: Path) -> dict[str, Any]:
    description = tiff.pages.first.tags.get("ImageDescription")
    text = description.value if description is not None else ""
    if not isinstance(text, str) or len(text) > _MAX_DESCRIPTION_BYTES:
        text = ""
    try:
        json_text = ET.fromstring(text).findtext(_METADATA_PATH)
    except ET.ParseError:
        json_text = None
    if not json_text:
        raise InputError(
            f"{path}: a TIFF, but not a captured set, or cut short; ps4rig import makes one of "
            "plain images"
        )
    try:
        fields = json.loads(json_text)
        # JSON may escape half a surrogate pair, which cannot be printed or written.
        json.dumps(fields, ensure_ascii=False).encode("utf-8")
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: the metadata are not valid JSON ({error})") from error
    version = fields.get("schema_version") if isinstance(fields, dict) else None
    if version != SCHEMA_VERSION or not isinstance(version, int):
        raise OtherVersionError(
            f"{path}: captured-set version {version!r:.40}, this program reads {SCHEMA_VERSION}; "
            "use the ps4rig that wrote it"
        )
    if fields.get("sha256") != fields_sha256(fields):
        raise InputError(
            f"{path}: the metadata do not match their SHA-256; they were changed after the set "
            "was captured, use the original"
        )
    return dict(fields)
