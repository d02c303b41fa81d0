"""The files of ``ps4rig export``: sets, heights and meshes for other programs.

A set becomes a NumPy ``.npz``, or a folder of TIFF with ``lights.lp`` for RTI; heights become
``.x3p`` or Digital Surf ``.sur``, or a mesh.
"""

from __future__ import annotations

import hashlib
import shlex
import struct
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from capture.base.errors import SetRejected
from capture.sets.captured_set import CapturedSet, LoadedSet
from capture.sets.light_list import write_light_list
from capture.sets.metadata import SetMetadata
from capture.sets.photographs import EXPORTED_METADATA
from classify import InputError, SurfaceEstimate, integrate_gradients
from classify.base.arrays import Array, FloatMap
from classify.base.durable_file import durable_file, durable_folder

_LIGHTS, _AMBIENT, _MASK = "lights.lp", "ambient.tif", "mask.tif"


def write_light_folder(captured: CapturedSet, folder: Path) -> str:
    """Write the camera's pixel values and light directions.

    Returns the quoted options with which ``ps4rig import`` reads them back.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: exists and is not empty; choose another name")
    digits = len(str(len(captured.images) - 1))
    names = [f"light{index:0{digits}d}.tif" for index in range(len(captured.images))]
    pages = dict(zip(names, captured.images, strict=True))
    options = ["--lights", str(folder / _LIGHTS)]
    if captured.ambient is not None:
        pages[_AMBIENT] = captured.ambient
        options += ["--ambient", str(folder / _AMBIENT)]
    if captured.mask is not None:
        pages[_MASK] = captured.mask.astype("u2") * 65535
        options += ["--mask", str(folder / _MASK)]
    with durable_folder(folder, [*pages, _LIGHTS, EXPORTED_METADATA], _LIGHTS) as temporary:
        for name, page in pages.items():
            tifffile.imwrite(temporary / name, page, photometric="minisblack")
        write_light_list(temporary / _LIGHTS, captured.lighting, names)
        (temporary / EXPORTED_METADATA).write_text(
            captured.metadata.model_dump_json(indent=1), encoding="utf-8"
        )
    if captured.metadata.mm_per_px is not None:
        options += ["--mm-per-px", str(captured.metadata.mm_per_px)]
    # Full scale may be shifted to the upper bits: its ones are the depth.
    return shlex.join([*options, "--bits", str(captured.metadata.full_scale.bit_count())])


def write_numpy_file(captured: CapturedSet, path: Path) -> None:
    """Write images, ambient image, mask, lights and metadata (JSON text) under their names."""
    lighting = captured.lighting
    arrays = {
        "images": captured.images,
        "ambient": captured.ambient,
        "mask": captured.mask,
        "directions": lighting.directions,
        "intensities": lighting.intensities,
        "positions_px": lighting.positions_px,
        "metadata": np.array(captured.metadata.model_dump_json()),
    }
    present = {name: array for name, array in arrays.items() if array is not None}
    with durable_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **present)


def _solved_height(loaded: LoadedSet) -> tuple[SurfaceEstimate, FloatMap]:
    """Solve a set and integrate its slopes: height in px, NaN where no slope is known."""
    surface = loaded.solve()
    if not surface.valid.any():
        raise SetRejected(
            f"{loaded.captured.path}: no pixel can be solved; check exposure and lights"
        )
    height = integrate_gradients(surface.p, surface.q, surface.valid)
    height[~surface.valid] = np.nan
    return surface, height


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights on the grid of the pixels, rows from the top of the image."""

    heights_mm: FloatMap  # (H, W) float32, NaN where no slope is known
    mm_per_px: float
    scale_date: str  # of the measurement of the scale, or of the import that was given it
    captured_at: datetime
    metadata: SetMetadata
    method: str

    @classmethod
    def of(cls, loaded: LoadedSet) -> HeightMap:
        """Solve a set with its calibration, and integrate its slopes."""
        metadata, mm_per_px = loaded.captured.metadata, loaded.mm_per_px
        if mm_per_px is None:
            raise InputError(
                "has no scale, and the file holds lengths; measure it with ps4rig calibrate scale, "
                "import photographs with --mm-per-px, or export to .ply or .stl"
            )
        calibration = loaded.found_calibration
        scale = None if calibration is None else calibration.file.records.get("scale")
        date = metadata.capture_date or metadata.created_utc
        try:
            captured_at = datetime.fromisoformat(date)
        except ValueError:
            field = "photographed" if date == metadata.photographed else "created_utc"
            raise InputError(
                f"metadata field {field}: {date!r} is not a date; capture the part again, or "
                "export to .ply or .stl"
            ) from None
        surface, heights_mm = _solved_height(loaded)
        heights_mm *= mm_per_px
        return cls(
            heights_mm=heights_mm,
            mm_per_px=mm_per_px,
            scale_date=metadata.created_utc if scale is None else scale.date,
            captured_at=captured_at,
            metadata=metadata,
            method=surface.method,
        )

    @property
    def comment(self) -> str:
        """The set and the source of its heights, as text for the file."""
        metadata = self.metadata
        sentences = (
            "SIMULATED." if metadata.simulated else None,
            metadata.label and f"Label {metadata.label}.",
            metadata.specimen and f"Specimen {metadata.specimen}.",
            f"Heights by photometric stereo ({self.method}), integrated from slopes:",
            "errors of form grow with distance.",
            f"Pixels SHA-256 {metadata.pixels_sha256}.",
        )
        return " ".join(filter(None, sentences))


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


# Fields and sizes of the header, as surfalize and rosettasciio read it.
_HEADER = struct.Struct("<12s4h30s30s5hf4xh5i3f" + 9 * "16s" + "3f3h12x7hfI6x2h128s5f13s13s")
_SURFACE = 2
_BITS = 32
# Largest point, as a number of steps above the offset; 32 bits could hold twice as many.
_HIGHEST = 2**30
# Readers differ in whether the lowest point is subtracted (rosettasciio) or not (surfalize), and in
# the unit of the offset. With 0 as the lowest point and micrometres they agree.
_LOWEST = 0
_MIN_RANGE_UM = 1e-9  # of a level surface; far below the resolution of any instrument
_MISSING = _LOWEST - 2  # by the format
_UNIT, _UM_PER_MM = "\N{MICRO SIGN}m", 1e3
_MAX_COMMENT_BYTES = 2**15 - 1


def write_sur(path: Path, heights: HeightMap) -> None:
    """Write heights in micrometres, rows from the top; NaN becomes a missing point."""
    heights_um = _UM_PER_MM * heights.heights_mm.astype(np.float64)
    missing = np.isnan(heights_um)
    # Offset and step are float32 in the file, so the points are computed from the rounded values.
    offset_um = np.nextafter(np.float32(np.nanmin(heights_um)), np.float32(-np.inf))
    heights_um -= offset_um
    step_um = np.float32(max(np.nanmax(heights_um), _MIN_RANGE_UM) / _HIGHEST)
    points = np.rint(np.where(missing, 0.0, heights_um) / step_um).astype("<i4")
    points[missing] = _MISSING
    metadata, (rows, columns) = heights.metadata, points.shape
    date, um_per_px = heights.captured_at, _UM_PER_MM * heights.mm_per_px
    comment = heights.comment.encode("latin-1", "replace")[:_MAX_COMMENT_BYTES]
    header = _HEADER.pack(
        b"DIGITAL SURF", 0, 1, 1, _SURFACE,  # for PCs, one object, version 1
        _text(metadata.label, 30), _text(metadata.operator, 30),
        0, 0, 0, int(missing.any()), 0,  # no kind of acquisition, range or absolute height
        0.0, _BITS, _LOWEST, _HIGHEST, columns, rows, points.size,
        um_per_px, um_per_px, step_um,
        *(_text(text, 16) for text in ("X", "Y", "Z", *[_UNIT] * 6)), 1.0, 1.0, 1.0,
        0, 0, 0,  # neither replica, inverted nor levelled
        date.second, date.minute, date.hour, date.day, date.month, date.year, date.isoweekday() % 7,
        0.0, 0, len(comment), 0, _text(f"ps4rig {metadata.software_version}", 128),
        0.0, 0.0, offset_um, 0.0, 0.0, _text("", 13), _text("", 13),
    )  # fmt: skip
    with durable_file(path) as temporary, temporary.open("wb") as file:
        file.write(header + comment)
        file.write(points.tobytes())


def _text(text: str | None, size: int) -> bytes:
    return (text or "").encode("latin-1", "replace")[:size].ljust(size)


def scaled_height(loaded: LoadedSet) -> tuple[SurfaceEstimate, FloatMap, float, str]:
    """Solve a set; return surface, height, length of a pixel, and the unit of both lengths."""
    surface, height = _solved_height(loaded)
    if loaded.mm_per_px is None:
        return surface, height, 1.0, "px, relative"
    height *= loaded.mm_per_px
    return surface, height, loaded.mm_per_px, "mm"


def write_ply(path: Path, height: FloatMap, albedo: FloatMap, per_px: float, unit: str) -> None:
    """Write a mesh with grey vertices and holes at NaN (Stanford PLY 1.0, little-endian).

    `height`, and `per_px`, the length of a pixel, are in `unit`.
    """
    is_finite = np.isfinite(height)
    white = float(np.percentile(albedo[is_finite], 99.5)) or 1.0
    positions, corners = _triangles(height, per_px)
    vertices = np.empty(len(positions), [("position", "<f4", 3), ("grey", "u1", 3)])
    vertices["position"] = positions
    grey = np.clip(255.0 / white * albedo[is_finite] + 0.5, 0.0, 255.0).astype(np.uint8)
    vertices["grey"] = grey[:, None]
    faces = np.empty(len(corners), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, corners
    header = "\n".join(
        [
            "ply", "format binary_little_endian 1.0", f"comment lengths in {unit}",
            f"element vertex {len(vertices)}",
            *(f"property float {name}" for name in "xyz"),
            *(f"property uchar {name}" for name in ("red", "green", "blue")),
            f"element face {len(faces)}", "property list uchar int vertex_indices",
            "end_header", "",
        ]
    )  # fmt: skip
    with durable_file(path) as temporary, temporary.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(vertices.tobytes())
        file.write(faces.tobytes())


def write_stl(path: Path, height: FloatMap, per_px: float, unit: str) -> None:
    """Write a mesh without colours (binary STL); its header names the unit. See `write_ply`."""
    positions, corners = _triangles(height, per_px)
    triangles = positions[corners]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.zeros(len(triangles), [("vectors", "<f4", (4, 3)), ("attribute", "<u2")])
    rows["vectors"][:, 0], rows["vectors"][:, 1:] = normals, triangles
    with durable_file(path) as temporary, temporary.open("wb") as file:
        file.write(f"ps4rig height, lengths in {unit}".encode("ascii").ljust(80))
        file.write(np.uint32(len(rows)).astype("<u4").tobytes())
        file.write(rows.tobytes())


def _triangles(height: FloatMap, per_px: float) -> tuple[FloatMap, Array]:
    """(V, 3) positions of vertices from the middle of the frame, and (T, 3) indices of them."""
    rows, columns = height.shape
    positions = np.empty((rows, columns, 3), np.float32)
    positions[..., 0] = per_px * (np.arange(columns) - 0.5 * (columns - 1))
    positions[..., 1] = per_px * (0.5 * (rows - 1) - np.arange(rows))[:, None]
    positions[..., 2] = height
    is_finite = np.isfinite(height).ravel()
    corners = _corners(height.shape)
    vertex_of_pixel = np.cumsum(is_finite, dtype=np.int32) - 1
    corners = corners[is_finite[corners].all(axis=1)]
    return positions.reshape(-1, 3)[is_finite], vertex_of_pixel[corners]


def _corners(shape: tuple[int, ...]) -> Array:
    """(2 (H - 1)(W - 1), 3) pixels of the triangles, anticlockwise as seen by the camera."""
    rows, columns = shape
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    upper_left, upper_right = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    lower_left, lower_right = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    lower = np.stack([lower_left, lower_right, upper_left], axis=1)
    upper = np.stack([upper_left, lower_right, upper_right], axis=1)
    return np.concatenate([lower, upper])
