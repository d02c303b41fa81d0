"""Sets and maps as ImageJ shows them, with and without Bio-Formats, which is in Fiji."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from capture import CapturedSet
from capture.maps.files import write_maps
from capture.maps.map_tiff import read_map
from rig.set_file import pixels_sha256
from tests.suites import BIOFORMATS, IMAGEJ

pytestmark = pytest.mark.imagej

MM_PER_PX = 0.02
SET = Path(__file__).parents[1] / "data" / "sets" / "rock.ome.tif"
CHANNELS = ["tilt 0 deg", "tilt 90 deg", "tilt 180 deg", "tilt 270 deg", "ambient", "mask"]
MASKS = {"shadow": 4, "dropped": 255, "specular": 255, "valid": 255}
# Two JVMs' worth of start on a busy machine; it takes 6 s on two free cores.
TIMEOUT_S = 120.0

Opened = tuple[dict[str, Any], dict[str, np.ndarray]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set with a scale and a mask, and maps of it with and without a scale."""
    folder = tmp_path_factory.mktemp("opened")
    stored = CapturedSet.load(SET)
    mask = np.zeros(stored.images.shape[1:], np.bool_)
    mask[4:, :-6] = True
    metadata = stored.metadata.model_copy(
        update={
            "mm_per_px": MM_PER_PX,
            "mask_file": "mask.png",
            "pixels_sha256": pixels_sha256(stored.images, stored.ambient, mask),
        }
    )
    captured = replace(stored, metadata=metadata, mask=mask)
    captured.save(folder / "set.ome.tif")
    surface = captured.solve()
    write_maps(captured, surface, folder / "scaled", mm_per_px=MM_PER_PX)
    write_maps(captured, surface, folder / "relative")
    (folder / "relative" / "normals.tif").rename(folder / "relative-normals.tif")
    return folder


@pytest.fixture(scope="module")
def opened(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Opened:
    """What ImageJ shows of each file, and its pixels, by "imagej:FILE" and "bioformats:FILE"."""
    output = tmp_path_factory.mktemp("pixels") / "pixels.npz"
    maps = folder / "scaled"
    files = [folder / "set.ome.tif", folder / "relative-normals.tif"]
    files += [*sorted(maps.glob("*.tif")), *(maps / f"{name}.png" for name in MASKS)]
    script = Path(__file__).with_name("opened.py")
    command = [sys.executable, script, IMAGEJ, BIOFORMATS / "bioformats_package.jar", output]
    run = subprocess.run(
        [*map(str, command), *map(str, files)], stdout=subprocess.PIPE, check=True,
        timeout=TIMEOUT_S,
    )  # fmt: skip
    with np.load(output) as arrays:
        return json.loads(run.stdout), dict(arrays)


def test_bio_formats_gives_a_set_channels_with_names_colours_and_scale(opened: Opened) -> None:
    shown = opened[0]["bioformats:set.ome.tif"]
    assert shown["schema_error"] is None
    assert (shown["bits"], shown["channels"], shown["names"]) == (16, 6, CHANNELS)
    assert shown["colours"] == [
        [255, 0, 0], [128, 255, 0], [0, 255, 255], [128, 0, 255], [255] * 3, [255] * 3,
    ]  # fmt: skip
    assert shown["unit"] == "micron"
    assert [shown["width"], shown["height"]] == pytest.approx([1e3 * MM_PER_PX] * 2)


def test_imagej_alone_labels_the_pages_of_a_set_and_knows_its_scale(opened: Opened) -> None:
    shown = opened[0]["imagej:set.ome.tif"]
    assert (shown["bits"], shown["grey"], shown["labels"]) == (16, True, CHANNELS)
    assert shown["unit"] == "cm"
    assert [shown["width"], shown["height"]] == pytest.approx([0.1 * MM_PER_PX] * 2)


def test_both_show_the_pixels_that_tifffile_reads(opened: Opened, folder: Path) -> None:
    pixels = opened[1]
    files = [folder / "set.ome.tif", *sorted((folder / "scaled").glob("*.tif"))]
    assert len(files) == 1 + 10 + len(MASKS)
    for file in files:
        values = tifffile.imread(file)
        for program in ("imagej", "bioformats"):
            # Java has no unsigned numbers: the bits are compared.
            seen = pixels[f"{program}:{file.name}"].view(values.dtype)
            np.testing.assert_array_equal(seen, values.reshape(seen.shape), err_msg=file.name)


def test_normals_open_as_three_float_channels(opened: Opened) -> None:
    for name in ("normals.tif", "relative-normals.tif"):
        shown = opened[0][f"imagej:{name}"]
        assert (shown["bits"], shown["channels"], shown["slices"]) == (32, 3, 3)
        assert (shown["labels"], shown["limits"]) == (["x", "y", "z"], [-1.0, 1.0])
        assert opened[0][f"bioformats:{name}"]["channels"] == 3
    length = np.linalg.norm(opened[1]["imagej:normals.tif"], axis=0)
    valid = opened[1]["imagej:valid.tif"].reshape(length.shape) != 0
    np.testing.assert_allclose(length[valid], 1.0, atol=1e-5)
    assert np.isnan(length[~valid]).all()


def test_masks_open_as_8_bit_grey(opened: Opened) -> None:
    for name, top in MASKS.items():
        shown = opened[0][f"imagej:{name}.tif"]
        assert (shown["bits"], shown["grey"], shown["limits"]) == (8, True, [0.0, top])
    for name in ("specular", "valid"):
        shown = opened[0][f"imagej:{name}.png"]
        assert (shown["bits"], shown["grey"]) == (8, True)


def test_maps_have_the_scale_and_say_their_origin(opened: Opened, folder: Path) -> None:
    for file in sorted((folder / "scaled").glob("*.tif")):
        shown = opened[0][f"imagej:{file.name}"]
        mm = {"mm": 1.0, "cm": 10.0}[shown["unit"]]
        assert mm * shown["width"] == pytest.approx(MM_PER_PX)
        assert json.dumps(read_map(file)[1]) in shown["info"]
    for program in ("imagej", "bioformats"):
        assert opened[0][f"{program}:relative-normals.tif"]["unit"] == "pixel"
