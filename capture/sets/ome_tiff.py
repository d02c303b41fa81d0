"""A captured set as one multi-page 16-bit OME-TIFF that Fiji, QuPath and tifffile open."""

import colorsys
import hashlib
import json
import threading
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import tifffile
from pydantic import ValidationError

from capture.base.names import SET_SUFFIX
from classify.base.arrays import BoolArray
from classify.base.durable_file import durable_file
from classify.base.errors import InputError
from classify.base.models import first_fault
from classify.base.threads import in_background
from rig.set_file import (
    NAMESPACE,
    Planes,
    fields_sha256,
    hash_page,
    pages,
    pixels_sha256,
    read_set_file,
    read_set_header,
)

from .metadata import SetMetadata


class PixelHash:
    """SHA-256 of a set's pages (`pixels_sha256`), which may be added in any order.

    One task hashes all pages that are due, because tasks that wait for each other could deadlock.
    """

    def __init__(self) -> None:
        self._digest = hashlib.sha256()
        self._waiting: dict[int, Planes] = {}  # pages that come before their turn
        self._next = 0
        # Shared with the thread that hashes.
        self._lock = threading.Lock()
        self._due: deque[Planes] = deque()
        self._is_hashing = False
        self._wait_until_hashed: Callable[[], None] = lambda: None

    def add(self, page: int, plane: Planes) -> None:
        """Add a page that is not there yet; return at once."""
        if self.has(page):
            raise ValueError(f"page {page} is added a second time")
        self._waiting[page] = plane
        with self._lock:
            while self._next in self._waiting:
                self._due.append(self._waiting.pop(self._next))
                self._next += 1
            must_start = bool(self._due) and not self._is_hashing
            self._is_hashing |= must_start
        if must_start:
            self._wait_until_hashed = in_background(self._hash_due)

    def has(self, page: int) -> bool:
        """Whether a page was added."""
        return page < self._next or page in self._waiting

    def sha256(self) -> str:
        """Wait for all pages and return the hash; ValueError if one before the last is missing."""
        if self._waiting:
            raise ValueError(f"page {self._next} is missing")
        wait_until_hashed, self._wait_until_hashed = self._wait_until_hashed, lambda: None
        wait_until_hashed()
        return self._digest.hexdigest()

    def _hash_due(self) -> None:
        while True:
            with self._lock:
                if not self._due:
                    self._is_hashing = False
                    return
                plane = self._due.popleft()
            hash_page(self._digest, plane)


_WHITE = -1  # 0xFFFFFFFF: opaque white in OME-XML
_OME = "http://www.openmicroscopy.org/Schemas/OME/2016-06"


def write(
    path: Path,
    images: Planes,
    ambient: Planes | None,
    metadata: SetMetadata,
    mask: BoolArray | None = None,
    home: Path | None = None,
    *,
    is_hashed: bool = False,
) -> None:
    """Write a captured set to `path`, whole or not at all, by a temporary file in `home`.

    `is_hashed` tells that the hash in the metadata is known to be that of the arrays.
    """
    if not path.name.endswith(SET_SUFFIX):
        raise InputError(
            f"{path}: a captured set is an OME-TIFF; its name must end in {SET_SUFFIX}"
        )
    if not is_hashed and pixels_sha256(images, ambient, mask) != metadata.pixels_sha256:
        raise InputError(f"{path}: pixels_sha256 in the metadata is not the hash of the pixels")
    planes = pages(images, ambient, mask)
    channels = _channels(metadata)
    # ImageJ without Bio-Formats does not read the OME-XML, but its own tags and the resolution.
    labels = tifffile.imagej_metadata_tag({"Labels": list(page_names(metadata))}, "<")
    with durable_file(path, home) as temporary:
        tifffile.imwrite(
            temporary, iter(planes), shape=(len(planes), *planes[0].shape), dtype="<u2",
            byteorder="<", photometric="minisblack", planarconfig=None,
            description=_ome_xml(images.shape[1:], channels, metadata), metadata=None,
            software=f"ps4rig {metadata.software_version}", extratags=labels,
            **resolution(metadata.mm_per_px),
        )  # fmt: skip


def read(path: Path) -> tuple[Planes, Planes | None, SetMetadata, BoolArray | None]:
    """Read light images, ambient image, metadata and mask."""
    planes, fields = read_set_file(path)
    metadata = _metadata(path, fields, len(planes))
    lights = len(metadata.lighting.directions)
    ambient = planes[lights] if len(metadata.images) > lights else None
    mask = None if metadata.mask_file is None else planes[-1] > 0
    return planes[:lights], ambient, metadata, mask


def read_header(path: Path) -> tuple[SetMetadata, tuple[int, int]]:
    """Read the metadata, and rows and columns of the images, but no pixel."""
    fields, (pages, rows, columns) = read_set_header(path)
    return _metadata(path, fields, pages), (rows, columns)


def _metadata(path: Path, fields: dict[str, Any], pages: int) -> SetMetadata:
    try:
        metadata = SetMetadata.model_validate(
            {name: value for name, value in fields.items() if name != "sha256"}
        )
        metadata.lighting.to_lighting()
    except ValidationError as error:
        raise InputError(f"{path}: metadata field {first_fault(error)}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    lights = len(metadata.lighting.directions)
    order = [record.light for record in metadata.images]
    if order not in (list(range(lights)), [*range(lights), None]):
        raise InputError(
            f"{path}: metadata field images does not list the {lights} lights in order"
        )
    listed = len(order) + (metadata.mask_file is not None)
    if pages != listed:
        raise InputError(f"{path}: holds {pages} images, its metadata name {listed}")
    return metadata


def resolution(mm_per_px: float | None) -> dict[str, Any]:
    """Return the options of `tifffile.imwrite` that tell the scale of an image."""
    if mm_per_px is None:
        return {}
    per_cm = 10.0 / mm_per_px
    return {"resolution": (per_cm, per_cm), "resolutionunit": "CENTIMETER"}


def page_names(metadata: SetMetadata) -> tuple[str, ...]:
    """Return the names of the pages: the tilts of the lights, then ``ambient`` and ``mask``."""
    return tuple(name for name, _ in _channels(metadata))


def _channels(metadata: SetMetadata) -> list[tuple[str, int]]:
    """Name and OME colour of each page; the tilt of a light is its hue."""
    tilts_deg = metadata.lighting.to_lighting().tilts_deg
    channels = []
    for record in metadata.images:
        if record.light is None:
            channels.append(("ambient", _WHITE))
            continue
        tilt_deg = tilts_deg[record.light]
        rgb = colorsys.hsv_to_rgb(tilt_deg / 360.0 % 1.0, 1.0, 1.0)
        channels.append((f"tilt {tilt_deg:g} deg", _ome_colour(rgb)))
    if metadata.mask_file is not None:
        channels.append(("mask", _WHITE))
    return channels


def _ome_colour(rgb: tuple[float, float, float]) -> int:
    """Return red, green and blue, 0 to 1, as the opaque colour number of OME-XML."""
    rgba = bytes([*(round(255.0 * share) for share in rgb), 255])
    return int.from_bytes(rgba, "big", signed=True)


def _ome_xml(
    shape: tuple[int, ...], channels: list[tuple[str, int]], metadata: SetMetadata
) -> bytes:
    rows, columns = shape
    ome = ET.Element("OME", {"xmlns": _OME, "Creator": f"ps4rig {metadata.software_version}"})
    image = ET.SubElement(ome, "Image", ID="Image:0", Name=metadata.label or "captured set")
    with suppress(ValueError):  # a set may have no date, or one that is not in ISO 8601
        captured = datetime.fromisoformat(metadata.capture_date or "")
        if captured.tzinfo is not None:
            captured = captured.astimezone(UTC).replace(tzinfo=None)
        # To the second: the labels that Bio-Formats makes of slices fail on fractions.
        ET.SubElement(image, "AcquisitionDate").text = captured.isoformat(timespec="seconds")
    pixels = ET.SubElement(
        image, "Pixels", ID="Pixels:0", DimensionOrder="XYCZT", Type="uint16",
        SignificantBits=str(metadata.full_scale.bit_length()), SizeX=str(columns), SizeY=str(rows),
        SizeC=str(len(channels)), SizeZ="1", SizeT="1", BigEndian="false",
    )  # fmt: skip
    if metadata.mm_per_px is not None:
        for axis in "XY":
            pixels.set(f"PhysicalSize{axis}", f"{metadata.mm_per_px:.9g}")
            pixels.set(f"PhysicalSize{axis}Unit", "mm")
    for index, (name, colour) in enumerate(channels):
        ET.SubElement(
            pixels, "Channel", ID=f"Channel:0:{index}", Name=name, Color=str(colour),
            SamplesPerPixel="1",
        )  # fmt: skip
    ET.SubElement(pixels, "TiffData")
    ET.SubElement(image, "AnnotationRef", ID="Annotation:0")
    annotations = ET.SubElement(ome, "StructuredAnnotations")
    comment = ET.SubElement(
        annotations, "CommentAnnotation", ID="Annotation:0", Namespace=NAMESPACE
    )
    fields = metadata.model_dump(mode="json")
    fields["sha256"] = fields_sha256(fields)
    ET.SubElement(comment, "Value").text = json.dumps(fields)
    # ASCII with character references: a TIFF description has no other encoding to rely on.
    xml: bytes = ET.tostring(ome, encoding="us-ascii", xml_declaration=True)
    return xml
