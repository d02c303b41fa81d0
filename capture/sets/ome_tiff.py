"""A captured set as one multi-page 16-bit OME-TIFF that Fiji, QuPath and tifffile open."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from pydantic import ValidationError

from classify.durable_file import durable_file
from classify.errors import InputError
from rig.set_file import (
    NAMESPACE,
    Planes,
    fields_sha256,
    pixels_sha256,
    read_set_file,
    read_set_header,
)  # fmt: skip

from .metadata import SetMetadata

SUFFIX = ".ome.tif"
_OME = "http://www.openmicroscopy.org/Schemas/OME/2016-06"


def write(path: Path, images: Planes, ambient: Planes | None, metadata: SetMetadata) -> None:
    """Write a captured set to `path`, whole or not at all.

    Raises
    ------
    InputError
        If the name does not end in ``.ome.tif``, the metadata belong to other pixels, or the file
        cannot be written.
    """
    if not path.name.endswith(SUFFIX):
        raise InputError(f"{path}: a captured set is an OME-TIFF; let its name end in {SUFFIX}")
    if pixels_sha256(images, ambient) != metadata.pixels_sha256:
        raise InputError(f"{path}: pixels_sha256 in the metadata is not the hash of the pixels")
    planes = images if ambient is None else np.concatenate([images, ambient[None]])
    with durable_file(path) as temporary:
        tifffile.imwrite(
            temporary, planes, byteorder="<", photometric="minisblack", planarconfig=None,
            description=_ome_xml(images.shape[1:], metadata), metadata=None,
            software=f"ps4rig {metadata.software_version}",
        )  # fmt: skip


def read(path: Path) -> tuple[Planes, Planes | None, SetMetadata]:
    """Read light images, ambient image and metadata.

    Raises
    ------
    InputError
        As `rig.set_file.read_set_file`, or if a metadata field is wrong.
    """
    planes, fields = read_set_file(path)
    metadata = _metadata(path, fields, len(planes))
    lights = len(metadata.lighting.directions)
    return planes[:lights], planes[lights] if len(planes) > lights else None, metadata


def read_header(path: Path) -> tuple[SetMetadata, tuple[int, int]]:
    """Read the metadata, and rows and columns of the images, but no pixel. Errors as `read`."""
    fields, (pages, rows, columns) = read_set_header(path)
    return _metadata(path, fields, pages), (rows, columns)


def _metadata(path: Path, fields: dict[str, Any], pages: int) -> SetMetadata:
    try:
        metadata = SetMetadata.model_validate(
            {name: value for name, value in fields.items() if name != "sha256"}
        )
        metadata.lighting.to_lighting()
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(f"{path}: metadata field {place}: {first['msg']}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    lights = len(metadata.lighting.directions)
    order = [record.light for record in metadata.images]
    if order not in (list(range(lights)), [*range(lights), None]):
        raise InputError(
            f"{path}: metadata field images does not list the {lights} lights in order"
        )
    if pages != len(order):
        raise InputError(f"{path}: holds {pages} images, its metadata name {len(order)}")
    return metadata


def _ome_xml(shape: tuple[int, ...], metadata: SetMetadata) -> bytes:
    rows, columns = shape
    ome = ET.Element("OME", {"xmlns": _OME, "Creator": f"ps4rig {metadata.software_version}"})
    image = ET.SubElement(ome, "Image", ID="Image:0", Name=metadata.label or "captured set")
    ET.SubElement(image, "AcquisitionDate").text = metadata.created_utc
    pixels = ET.SubElement(
        image, "Pixels", ID="Pixels:0", DimensionOrder="XYCZT", Type="uint16",
        SignificantBits=str(metadata.full_scale.bit_length()), SizeX=str(columns), SizeY=str(rows),
        SizeC=str(len(metadata.images)), SizeZ="1", SizeT="1", BigEndian="false",
    )  # fmt: skip
    tilts_deg = metadata.lighting.to_lighting().tilts_deg
    for index, record in enumerate(metadata.images):
        name = "ambient" if record.light is None else f"tilt {tilts_deg[record.light]:g} deg"
        ET.SubElement(pixels, "Channel", ID=f"Channel:0:{index}", Name=name, SamplesPerPixel="1")
    ET.SubElement(pixels, "TiffData")
    ET.SubElement(image, "AnnotationRef", ID="Annotation:0")
    annotations = ET.SubElement(ome, "StructuredAnnotations")
    comment = ET.SubElement(
        annotations, "CommentAnnotation", ID="Annotation:0", Namespace=NAMESPACE
    )
    fields = metadata.model_dump(mode="json", by_alias=True)
    if metadata.is_protected:  # the metadata of a set of schema 1 were never verified
        fields["sha256"] = fields_sha256(fields)
    ET.SubElement(comment, "Value").text = json.dumps(fields)
    # ASCII with character references: a TIFF description has no other encoding to rely on.
    xml: bytes = ET.tostring(ome, encoding="us-ascii", xml_declaration=True)
    return xml
