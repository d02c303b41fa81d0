"""A height map as an ``.x3p`` file (ISO 25178-72): a zip of XML, binary heights and checksums."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from classify.base.durable_file import durable_file

from .height_map import HeightMap

_NAMESPACE = "http://www.opengps.eu/2008/ISO5436_2"
_MAIN, _DATA, _CHECKSUM = "main.xml", "bindata/data.bin", "md5checksum.hex"
_M_PER_MM = 1e-3
_NOT_KNOWN = "not available"


def write_x3p(path: Path, heights: HeightMap) -> None:
    """Write heights in metres as float64, NaN where none was measured; rows from the top."""
    data = (heights.heights_mm.astype("<f8") * _M_PER_MM).tobytes()
    main = _main_xml(heights, _md5(data))
    with durable_file(path) as temporary, zipfile.ZipFile(
        temporary, "w", zipfile.ZIP_DEFLATED
    ) as archive:  # fmt: skip
        archive.writestr(_MAIN, main)
        archive.writestr(_DATA, data)
        archive.writestr(_CHECKSUM, f"{_md5(main)} *{_MAIN}\n")


def _md5(data: bytes) -> str:
    # The format asks for MD5; it finds damage, not forgery.
    return hashlib.md5(data, usedforsecurity=False).hexdigest()


def _main_xml(heights: HeightMap, data_md5: str) -> bytes:
    metadata, (rows, columns) = heights.metadata, heights.heights_mm.shape
    axis = {
        "AxisType": "I",
        "DataType": "D",
        "Increment": repr(heights.mm_per_px * _M_PER_MM),
        "Offset": "0",
    }
    root = ET.Element("p:ISO5436_2", {"xmlns:p": _NAMESPACE})
    _add(root, {
        "Record1": {
            "Revision": "ISO5436 - 2000",
            "FeatureType": "SUR",
            "Axes": {"CX": axis, "CY": axis, "CZ": axis | {"AxisType": "A", "Increment": "1"}},
        },
        "Record2": {
            "Date": heights.captured_at.isoformat(),
            "Creator": metadata.operator or _NOT_KNOWN,
            "Instrument": {
                "Manufacturer": "ps4rig",
                "Model": "simulated rig" if metadata.simulated else metadata.rig_name or _NOT_KNOWN,
                "Serial": _NOT_KNOWN
                if metadata.controller is None
                else metadata.controller.serial_number,
                "Version": metadata.software_version,
            },
            "CalibrationDate": heights.scale_date,
            "ProbingSystem": {
                "Type": "NonContacting",
                "Identification": f"photometric stereo, {heights.method}",
            },
            "Comment": heights.comment,
        },
        "Record3": {
            "MatrixDimension": {"SizeX": columns, "SizeY": rows, "SizeZ": 1},
            "DataLink": {"PointDataLink": _DATA, "MD5ChecksumPointData": data_md5},
        },
        "Record4": {"ChecksumFile": _CHECKSUM},
    })  # fmt: skip
    xml: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return xml


def _add(parent: ET.Element, fields: Mapping[str, Any]) -> None:
    """Add elements in the order of the mapping; the schema prescribes this order."""
    for name, value in fields.items():
        child = ET.SubElement(parent, name)
        if isinstance(value, Mapping):
            _add(child, value)
        else:
            child.text = str(value)
