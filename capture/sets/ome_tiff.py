"""A captured set as one multi-page 16-bit OME-TIFF that Fiji, QuPath and tifffile open.

The light images come in order, then the ambient image. Everything else is JSON in a structured
annotation of the OME-XML, so that a reader in ten years needs no program of ours.
"""

from __future__ import annotations

import hashlib
import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import numpy.typing as npt
import tifffile
from pydantic import ValidationError

from classify.durable_file import durable_file, require_folder
from classify.errors import InputError

from .metadata import SCHEMA_VERSION, SetMetadata

__all__ = ["SUFFIX", "Planes", "check_path", "pixels_sha256", "read", "read_header", "write"]

SUFFIX = ".ome.tif"
_OME = "http://www.openmicroscopy.org/Schemas/OME/2016-06"
_NAMESPACE = "ps4rig/captured-set"
_MAX_DESCRIPTION_BYTES = 16 * 2**20
_MAX_PAGES = 256
_MAX_SIDE_PX = 32768

Planes = npt.NDArray[np.uint16]


def check_path(path: Path) -> None:
    """Make sure, before the work, that a set can be written to `path`.

    Raises
    ------
    InputError
        If the name does not end in ``.ome.tif``, or there is no such folder.
    """
    _check_name(path)
    require_folder(path)


def write(path: Path, images: Planes, ambient: Planes | None, metadata: SetMetadata) -> None:
    """Write the planes of a set and what is known about them to `path`, whole or not at all.

    Raises
    ------
    InputError
        If the name does not end in ``.ome.tif``, the metadata are about other pixels, or the file
        cannot be written.
    """
    _check_name(path)
    if pixels_sha256(images, ambient) != metadata.pixels_sha256:
        raise InputError(
            f"{path}: the pixels are not those of the metadata; give it their pixels_sha256"
        )
    planes = images if ambient is None else np.concatenate([images, ambient[None]])
    with durable_file(path) as temporary:
        tifffile.imwrite(
            temporary,
            planes,
            byteorder="<",
            photometric="minisblack",
            planarconfig=None,
            description=_ome_xml(images.shape[1:], metadata),
            metadata=None,
            software=f"ps4rig {metadata.software_version}",
        )


def read(path: Path) -> tuple[Planes, Planes | None, SetMetadata]:
    """Images, ambient image and metadata; every cause of failure is an `InputError` by name."""
    with _opened(path) as tiff:
        metadata, _ = _header(tiff, path)
        planes = np.stack([page.asarray() for page in tiff.pages])
    lights = len(metadata.lighting.directions)
    images = planes[:lights]
    ambient = planes[lights] if len(planes) > lights else None
    if pixels_sha256(images, ambient) != metadata.pixels_sha256:
        raise InputError(
            f"{path}: the pixels do not match their SHA-256; the file was changed or damaged "
            "after it was captured, use the original"
        )
    return images, ambient, metadata


def read_header(path: Path) -> tuple[SetMetadata, tuple[int, int]]:
    """Metadata, and rows and columns of the images; no pixel is read. Fails as `read` does."""
    with _opened(path) as tiff:
        return _header(tiff, path)


@contextmanager
def _opened(path: Path) -> Iterator[tifffile.TiffFile]:
    try:
        with tifffile.TiffFile(path) as tiff:
            yield tiff
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (PermissionError, IsADirectoryError) as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except InputError:
        raise
    # What tifffile raises on damaged files depends on where the damage is.
    except Exception as error:
        raise InputError(f"{path}: not a readable TIFF ({error}); it may be truncated") from error


def _check_name(path: Path) -> None:
    if not path.name.endswith(SUFFIX):
        raise InputError(f"{path}: a captured set is an OME-TIFF; let its name end in {SUFFIX}")


def _ome_xml(shape: tuple[int, ...], metadata: SetMetadata) -> bytes:
    rows, columns = shape
    ome = ET.Element("OME", {"xmlns": _OME, "Creator": f"ps4rig {metadata.software_version}"})
    image = ET.SubElement(ome, "Image", ID="Image:0", Name=metadata.label or "captured set")
    ET.SubElement(image, "AcquisitionDate").text = metadata.created_utc
    pixels = ET.SubElement(
        image,
        "Pixels",
        ID="Pixels:0",
        DimensionOrder="XYCZT",
        Type="uint16",
        SignificantBits=str(max(1, metadata.full_scale.bit_length())),
        SizeX=str(columns),
        SizeY=str(rows),
        SizeC=str(len(metadata.images)),
        SizeZ="1",
        SizeT="1",
        BigEndian="false",
    )
    tilts_deg = metadata.lighting.to_lighting().tilts_deg
    for index, record in enumerate(metadata.images):
        name = "ambient" if record.light is None else f"tilt {tilts_deg[record.light]:g} deg"
        ET.SubElement(pixels, "Channel", ID=f"Channel:0:{index}", Name=name, SamplesPerPixel="1")
    ET.SubElement(pixels, "TiffData")
    ET.SubElement(image, "AnnotationRef", ID="Annotation:0")
    annotations = ET.SubElement(ome, "StructuredAnnotations")
    comment = ET.SubElement(
        annotations, "CommentAnnotation", ID="Annotation:0", Namespace=_NAMESPACE
    )
    ET.SubElement(comment, "Value").text = json.dumps(
        metadata.model_dump(mode="json", by_alias=True)
    )
    # ASCII with character references: a TIFF description has no other encoding to rely on.
    xml: bytes = ET.tostring(ome, encoding="us-ascii", xml_declaration=True)
    return xml


def _metadata(tiff: tifffile.TiffFile, path: Path) -> SetMetadata:
    description = tiff.pages.first.tags.get("ImageDescription")
    text = description.value if description is not None else ""
    if not isinstance(text, str) or len(text) > _MAX_DESCRIPTION_BYTES:
        text = ""
    try:
        root = ET.fromstring(text)
    except ET.ParseError:
        root = ET.Element("none")
    value = root.find(f".//{{{_OME}}}CommentAnnotation[@Namespace='{_NAMESPACE}']/{{{_OME}}}Value")
    if value is None or value.text is None:
        raise InputError(
            f"{path}: a TIFF, but not a captured set; ps4rig import makes one of plain images"
        )
    try:
        fields = json.loads(value.text)
        version = fields.get("schema_version") if isinstance(fields, dict) else None
        if isinstance(version, int) and version > SCHEMA_VERSION:
            raise InputError(
                f"captured-set version {version}, this program reads up to "
                f"{SCHEMA_VERSION}; use a newer ps4rig"
            )
        metadata = SetMetadata.model_validate(fields)
        metadata.lighting.to_lighting()
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(f"{path}: metadata field {place}: {first['msg']}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: the metadata are not JSON ({error})") from error
    lights = len(metadata.lighting.directions)
    order = [record.light for record in metadata.images]
    if order not in (list(range(lights)), [*range(lights), None]):
        raise InputError(
            f"{path}: metadata field images does not list the {lights} lights in order"
        )
    return metadata


def _header(tiff: tifffile.TiffFile, path: Path) -> tuple[SetMetadata, tuple[int, int]]:
    metadata = _metadata(tiff, path)
    count, expected = len(tiff.pages), len(metadata.images)
    if count != expected or count > _MAX_PAGES:
        raise InputError(f"{path}: holds {count} images, its metadata name {expected}")
    shapes = {(page.shape, str(page.dtype)) for page in tiff.pages}
    shape, dtype = next(iter(shapes))
    if len(shapes) > 1 or dtype != "uint16" or len(shape) != 2 or max(shape) > _MAX_SIDE_PX:
        raise InputError(f"{path}: its pages are not grey 16-bit images of one size")
    rows, columns = shape
    return metadata, (rows, columns)


def pixels_sha256(images: Planes, ambient: Planes | None) -> str:
    """SHA-256 of the pixels, light images then ambient, as little-endian 16-bit rows."""
    digest = hashlib.sha256()
    for plane in (*images, *(() if ambient is None else (ambient,))):
        digest.update(np.ascontiguousarray(plane, dtype="<u2").data)
    return digest.hexdigest()
