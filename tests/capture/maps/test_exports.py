"""Heights as .x3p and .sur, read back by surfalize and by the letter of the format."""

import hashlib
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from capture import CalibrationFile, CapturedSet
from capture.calibration.ps4cal import PartRecord
from capture.maps.exports import HeightMap, write_sur, write_x3p
from classify.calibration.calibration import Scale

Command = Callable[..., Any]
Refused = Callable[..., str]
MM_PER_PX = 0.02
SET = Path(__file__).parents[2] / "data" / "sets" / "rock.ome.tif"
METADATA = CapturedSet.load(SET).metadata
UM_PER_MM = 1e3


@st.composite
def height_maps(draw: st.DrawFn) -> HeightMap:
    """Heights of any shape, of which one at least is known."""
    values = st.floats(-50.0, 50.0, width=32) | st.just(np.nan)
    shape = st_numpy.array_shapes(min_dims=2, max_dims=2, max_side=12)
    heights_mm = draw(st_numpy.arrays(np.float32, shape, elements=values))
    heights_mm[0, 0] = draw(st.floats(-50.0, 50.0, width=32))
    mm_per_px = draw(st.floats(1e-4, 10.0))
    captured_at = datetime(2026, 5, 4, 13, 5, 59, tzinfo=UTC)
    return HeightMap(heights_mm, mm_per_px, "2026-05-01T08:00:00Z", captured_at, METADATA, "ps4")


def surface_of(path: Path) -> Any:
    from surfalize import Surface

    return Surface.load(path)


@pytest.mark.parametrize(("suffix", "write"), [(".x3p", write_x3p), (".sur", write_sur)])
@settings(max_examples=25)
@given(heights=height_maps())
def test_a_file_has_the_heights_and_the_scale(
    tmp_path_factory: pytest.TempPathFactory,
    suffix: str,
    write: Callable[[Path, HeightMap], None],
    heights: HeightMap,
) -> None:
    path = tmp_path_factory.getbasetemp() / f"a{suffix}"
    write(path, heights)
    read = surface_of(path)
    expected = UM_PER_MM * heights.heights_mm.astype(np.float64)
    # Half a step of whole numbers in .sur; .x3p has no steps.
    step = np.nanmax(np.abs(expected)) / 2**30 if suffix == ".sur" else 0.0
    np.testing.assert_allclose(read.data, expected, rtol=1e-9, atol=step + 1e-12)
    assert (read.step_x, read.step_y) == pytest.approx((UM_PER_MM * heights.mm_per_px,) * 2)


def test_an_x3p_file_is_by_the_letter_of_the_schema(tmp_path: Path) -> None:
    heights_mm = np.array([[1.0, 2.0, np.nan], [4.0, 5.0, 6.0]], np.float32)
    captured_at = datetime(2026, 5, 4, 13, 5, 59, tzinfo=UTC)
    write_x3p(
        tmp_path / "a.x3p",
        HeightMap(heights_mm, 0.5, "2026-05-01T08:00:00Z", captured_at, METADATA, "ps4"),
    )
    with zipfile.ZipFile(tmp_path / "a.x3p") as archive:
        assert archive.namelist() == ["main.xml", "bindata/data.bin", "md5checksum.hex"]
        main, data = archive.read("main.xml"), archive.read("bindata/data.bin")
        checksum = archive.read("md5checksum.hex").decode("ascii")
    assert checksum == f"{hashlib.md5(main).hexdigest()} *main.xml\n"
    np.testing.assert_allclose(
        np.frombuffer(data, "<f8"), [1e-3, 2e-3, np.nan, 4e-3, 5e-3, 6e-3], rtol=1e-6
    )
    root = ET.fromstring(main)
    assert root.tag == "{http://www.opengps.eu/2008/ISO5436_2}ISO5436_2"

    def outline(element: ET.Element) -> Any:
        children = list(element)
        return {each.tag: outline(each) for each in children} if children else element.text

    record1, record2, record3, record4 = map(outline, root)
    side = {"AxisType": "I", "DataType": "D", "Increment": "0.0005", "Offset": "0"}
    assert record1["Axes"] == {
        "CX": side, "CY": side, "CZ": side | {"AxisType": "A", "Increment": "1"},
    }  # fmt: skip
    assert list(record2) == [
        "Date", "Creator", "Instrument", "CalibrationDate", "ProbingSystem", "Comment",
    ]  # fmt: skip
    assert record2["Comment"].startswith("SIMULATED. Label rock.")
    assert record2["Date"] == "2026-05-04T13:05:59+00:00"
    assert record3 == {
        "MatrixDimension": {"SizeX": "3", "SizeY": "2", "SizeZ": "1"},
        "DataLink": {
            "PointDataLink": "bindata/data.bin",
            "MD5ChecksumPointData": hashlib.md5(data).hexdigest(),
        },
    }
    assert record4 == {"ChecksumFile": "md5checksum.hex"}


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set with a dark corner, and its calibration of the scale beside it."""
    folder = tmp_path_factory.mktemp("calibrated")
    stored = CapturedSet.load(SET)
    images = stored.images.copy()
    assert stored.ambient is not None
    images[:, :6, :4] = stored.ambient[:6, :4]
    from rig.set_file import pixels_sha256

    hashed = {"pixels_sha256": pixels_sha256(images, stored.ambient)}
    captured = replace(stored, images=images, metadata=stored.metadata.model_copy(update=hashed))
    record = PartRecord(
        setting=captured.setting, quality="Good.", source=("captured",), date="2026-05-01"
    )
    scale = Scale(MM_PER_PX, 0.001, np.eye(3), None, 0.1)
    calibration = CalibrationFile().with_part("scale", scale, record)
    calibration.write(folder / "rig.ps4cal")
    captured.with_calibration(calibration).save(folder / "a.ome.tif")
    return folder / "a.ome.tif"


@pytest.mark.parametrize(("suffix", "unit"), [(".x3p", "m"), (".sur", "um")])
def test_a_set_becomes_a_measured_surface(
    ps4rig: Command, calibrated: Path, tmp_path: Path, suffix: str, unit: str
) -> None:
    output = tmp_path / f"a{suffix}"
    result = ps4rig("export", calibrated, output)
    assert result.stdout == f"{output}: written, lengths in {unit}\n", result.stderr
    assert ps4rig("export", calibrated, tmp_path / "maps", "--maps").exit_code == 0
    height_um = UM_PER_MM * tifffile.imread(tmp_path / "maps" / "height.tif")
    valid = tifffile.imread(tmp_path / "maps" / "valid.tif") > 0
    assert 0 < np.count_nonzero(~valid) < valid.size
    height_um[~valid] = np.nan
    read = surface_of(output)
    np.testing.assert_allclose(read.data, height_um, rtol=1e-6, atol=1e-6)
    assert (read.step_x, read.step_y) == pytest.approx((UM_PER_MM * MM_PER_PX,) * 2)


@pytest.mark.parametrize("name", ["a.x3p", "a.sur"])
def test_a_set_without_a_scale_is_refused(refused: Refused, tmp_path: Path, name: str) -> None:
    assert refused("export", SET, tmp_path / name).startswith(f"{SET}: has no scale")
    assert not list(tmp_path.iterdir())


def test_maps_are_those_of_solve(ps4rig: Command, refused: Refused, tmp_path: Path) -> None:
    answer = json.loads(ps4rig("export", SET, tmp_path / "maps", "--maps", "--json").stdout)
    assert set(answer["files"]) == {path.name for path in (tmp_path / "maps").iterdir()}
    assert {"height.tif", "normals.tif", "index.html"} <= set(answer["files"])
    wrong = refused("export", SET, tmp_path / "a.npz", "--maps")
    assert wrong.endswith("the end of the name")
