"""A captured set as one multi-page 16-bit OME-TIFF that Fiji, QuPath and tifffile open."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import tifffile
from pydantic import ValidationError

from classify.durable_file import durable_file
from classify.errors import InputError
from rig.set_file import (
    NAMESPACE,
    Planes,
    fields_sha256,
    pages,
    pixels_sha256,
    read_set_file,
    read_set_header,
)  # fmt: skip

from .metadata import SetMetadata

Mask = npt.NDArray[np.bool_]

SUFFIX = ".ome.tif"
_OME = "http://www.openmicroscopy.org/Schemas/OME/2016-06"


def write(
    path: Path,
    images: Planes,
    ambient: Planes | None,
    metadata: SetMetadata,
    mask: Mask | None = None,
) -> None:
    """Write a captured set to `path`, whole or not at all.

    Raises
    ------
    InputError
        If the name does not end in ``.ome.tif``, the metadata belong to other pixels, or the file
        cannot be written.
    """
    if not path.name.endswith(SUFFIX):
        raise InputError(f"{path}: a captured set is an OME-TIFF; let its name end in {SUFFIX}")
    if pixels_sha256(images, ambient, mask) != metadata.pixels_sha256:
        raise InputError(f"{path}: pixels_sha256 in the metadata is not the hash of the pixels")
    planes = np.stack(pages(images, ambient, mask))
    with durable_file(path) as temporary:
        tifffile.imwrite(
            temporary, planes, byteorder="<", photometric="minisblack", planarconfig=None,
            description=_ome_xml(images.shape[1:], metadata), metadata=None,
            software=f"ps4rig {metadata.software_version}",
        )  # fmt: skip


def read(path: Path) -> tuple[Planes, Planes | None, SetMetadata, Mask | None]:
    """Read light images, ambient image, metadata and mask.

    Raises
    ------
    InputError
        As `rig.set_file.read_set_file`, or if a metadata field is wrong.
    """
    planes, fields = read_set_file(path)
    metadata = _metadata(path, fields, len(planes))
    lights = len(metadata.lighting.directions)
    ambient = planes[lights] if len(metadata.images) > lights else None
    mask = None if metadata.mask_file is None else planes[-1] > 0
    return planes[:lights], ambient, metadata, mask


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
    named = len(order) + (metadata.mask_file is not None)
    if pages != named:
        raise InputError(f"{path}: holds {pages} images, its metadata name {named}")
    return metadata


def _ome_xml(shape: tuple[int, ...], metadata: SetMetadata) -> bytes:
    rows, columns = shape
    tilts_deg = metadata.lighting.to_lighting().tilts_deg
    names = [
        "ambient" if record.light is None else f"tilt {tilts_deg[record.light]:g} deg"
        for record in metadata.images
    ] + ["mask"] * (metadata.mask_file is not None)
    ome = ET.Element("OME", {"xmlns": _OME, "Creator": f"ps4rig {metadata.software_version}"})
    image = ET.SubElement(ome, "Image", ID="Image:0", Name=metadata.label or "captured set")
    ET.SubElement(image, "AcquisitionDate").text = metadata.created_utc
    pixels = ET.SubElement(
        image, "Pixels", ID="Pixels:0", DimensionOrder="XYCZT", Type="uint16",
        SignificantBits=str(metadata.full_scale.bit_length()), SizeX=str(columns), SizeY=str(rows),
        SizeC=str(len(names)), SizeZ="1", SizeT="1", BigEndian="false",
    )  # fmt: skip
    for index, name in enumerate(names):
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
