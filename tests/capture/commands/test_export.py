"""The command export, and its files as other programs read them."""

import json
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture import CapturedSet
from capture.maps.exports import write_ply, write_stl

Command = Callable[..., Any]
Refused = Callable[..., str]
FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
VERTEX = np.dtype([("place", "<f4", 3), ("grey", "u1", 3)])
TRIANGLE = np.dtype([("vectors", "<f4", (4, 3)), ("attribute", "<u2")])


@pytest.mark.parametrize("options", [(), ("--bits", 8), ("--average", 3)])
def test_a_folder_of_images_comes_back_with_the_same_pixels(
    ps4rig: Command, in_folder: Path, options: tuple[object, ...]
) -> None:
    path = in_folder / "my set.ome.tif"
    assert ps4rig("capture", "--rig", "sim", "--size", 64, *options, path).exit_code == 0
    answer = json.loads(ps4rig("export", path, "my images", "--json").stdout)
    back = ps4rig("import", *shlex.split(answer["import_options"]), "back.ome.tif")
    assert back.exit_code == 0, back.stderr
    before, after = CapturedSet.load(path), CapturedSet.load("back.ome.tif")
    np.testing.assert_array_equal(after.images, before.images)
    np.testing.assert_array_equal(after.ambient, before.ambient)
    np.testing.assert_allclose(after.lighting.directions, before.lighting.directions, atol=1e-8)
    assert after.metadata.full_scale == before.metadata.full_scale
    assert after.metadata.simulated
    about = json.loads((in_folder / "my images" / "metadata.json").read_text())
    assert about["pixels_sha256"] == before.metadata.pixels_sha256


@pytest.mark.usefixtures("in_folder")
@pytest.mark.parametrize("free_bits", [0, 4])
def test_a_masked_set_comes_back_with_its_mask_scale_and_saturation(
    ps4rig: Command, made_set: Callable[..., CapturedSet], free_bits: int
) -> None:
    rng = np.random.default_rng(1)
    pixels = rng.integers(500, 3000, (4, 40, 50)).astype(np.uint16) << free_bits
    mask = np.zeros((40, 50), np.bool_)
    mask[10:30, 5:45] = True
    masked = made_set(pixels, mask=mask)
    fields = {"mm_per_px": 0.05, "bit_depth": 12, "full_scale": 4095 << free_bits}
    replace(masked, metadata=masked.metadata.model_copy(update=fields)).save("masked.ome.tif")
    answer = json.loads(ps4rig("export", "masked.ome.tif", "images", "--json").stdout)
    options = shlex.split(answer["import_options"])
    accepted = ("--accept", "residual", "--accept", "light-order")
    assert ps4rig("import", *options, *accepted, "back.ome.tif").exit_code == 0
    back = CapturedSet.load("back.ome.tif")
    np.testing.assert_array_equal(back.mask, mask)
    assert back.metadata.mm_per_px == 0.05
    assert back.metadata.full_scale == 4095 << free_bits


def test_a_numpy_file_has_every_array(ps4rig: Command, in_folder: Path) -> None:
    assert ps4rig("capture", "--rig", "sim", "--size", 64, "a.ome.tif").exit_code == 0
    assert ps4rig("export", "a.ome.tif", "a.npz").stdout == "a.npz: written\n"
    captured = CapturedSet.load("a.ome.tif")
    with np.load(in_folder / "a.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["images"], captured.images)
        np.testing.assert_array_equal(arrays["ambient"], captured.ambient)
        np.testing.assert_array_equal(arrays["directions"], captured.lighting.directions)
        about = json.loads(str(arrays["metadata"]))
        assert set(arrays) == {"images", "ambient", "directions", "intensities", "metadata"}
    assert about["pixels_sha256"] == captured.metadata.pixels_sha256


def test_a_mesh_has_the_places_of_the_pixels_and_faces_the_camera(tmp_path: Path) -> None:
    height = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]], np.float32)
    albedo = np.linspace(0.0, 0.5, 6, dtype=np.float32).reshape(2, 3)
    write_ply(tmp_path / "a.ply", height, albedo, 0.5, "mm")
    header, _, body = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert "comment lengths in mm" in lines
    assert {"element vertex 6", "element face 4"} <= set(lines)
    vertices = np.frombuffer(body, VERTEX, 6)
    faces = np.frombuffer(body, FACE, 4, offset=6 * VERTEX.itemsize)
    assert len(body) == 6 * VERTEX.itemsize + 4 * FACE.itemsize
    np.testing.assert_allclose(vertices["place"][0], [-0.5, 0.25, 0.0])
    np.testing.assert_allclose(vertices["place"][5], [0.5, -0.25, 5.0])
    assert vertices["grey"][5].tolist() == [255, 255, 255]
    assert faces["count"].tolist() == [3] * 4

    write_stl(tmp_path / "a.stl", height, 0.5, "mm")
    data = (tmp_path / "a.stl").read_bytes()
    assert data.startswith(b"ps4rig height, lengths in mm ")
    assert np.frombuffer(data, "<u4", 1, offset=80)[0] == 4
    triangles = np.frombuffer(data, TRIANGLE, 4, offset=84)["vectors"]
    assert len(data) == 84 + 4 * TRIANGLE.itemsize
    np.testing.assert_array_equal(triangles[:, 1:], vertices["place"][faces["corners"]])
    assert (triangles[:, 0, 2] > 0.0).all()  # normals towards the camera
    np.testing.assert_allclose(np.linalg.norm(triangles[:, 0], axis=1), 1.0, rtol=1e-6)


def test_a_mesh_has_no_triangle_at_an_unknown_height(tmp_path: Path) -> None:
    height = np.arange(9, dtype=np.float32).reshape(3, 3)
    height[0, 0] = np.nan
    albedo = np.full((3, 3), 0.25, np.float32)
    albedo[0, 0] = 100.0
    write_ply(tmp_path / "a.ply", height, albedo, 1.0, "mm")
    header, _, body = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    assert {"element vertex 8", "element face 6"} <= set(header.decode("ascii").splitlines())
    vertices = np.frombuffer(body, VERTEX, 8)
    assert vertices["place"][:, 2].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    assert (vertices["grey"] == 255).all()
    faces = np.frombuffer(body, FACE, 6, offset=8 * VERTEX.itemsize)
    write_stl(tmp_path / "a.stl", height, 1.0, "mm")
    triangles = np.frombuffer((tmp_path / "a.stl").read_bytes(), TRIANGLE, 6, offset=84)
    np.testing.assert_array_equal(triangles["vectors"][:, 1:], vertices["place"][faces["corners"]])


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("a.obj", "a.obj: end the name"),
        ("full", "full: exists"),
        ("full/a.npz", "full/a.npz: exists already"),
        ("none/a.npz", "none/a.npz: cannot be written"),
    ],
)
def test_a_wrong_output_is_refused(
    ps4rig: Command, refused: Refused, in_folder: Path, output: str, message: str
) -> None:
    assert ps4rig("capture", "--rig", "sim", "--size", 64, "a.ome.tif").exit_code == 0
    (in_folder / "full").mkdir()
    (in_folder / "full" / "a.npz").touch()
    assert refused("export", "a.ome.tif", output).startswith(message)


def test_the_metadata_field_that_is_no_date_is_named(
    refused: Refused, made_set: Callable[..., CapturedSet], in_folder: Path
) -> None:
    captured = made_set(np.full((4, 8, 9), 1000, np.uint16))
    photographs = tuple(
        image.model_copy(update={"source_file": "a.png"}) for image in captured.metadata.images
    )
    imported = {"images": photographs, "photographed": "in May"}
    for fields, message in (
        ({"created_utc": "today"}, "created_utc: 'today' is not a date"),
        (imported, "photographed: 'in May' is not a date"),
    ):
        metadata = captured.metadata.model_copy(update={"mm_per_px": 0.1, **fields})
        replace(captured, metadata=metadata).save(in_folder / "a.ome.tif")
        assert f"metadata field {message}" in refused("export", "a.ome.tif", "a.x3p")


@pytest.mark.parametrize("name", ["a.ply", "a.stl"])
def test_a_mesh_is_that_of_the_valid_pixels(
    ps4rig: Command, refused: Refused, made_set: Callable[..., CapturedSet], in_folder: Path,
    name: str,
) -> None:  # fmt: skip
    mask = np.zeros((8, 9), np.bool_)
    mask[2:5, 3:7] = True
    made_set(np.full((4, 8, 9), 1000, np.uint16), mask=mask).save("a.ome.tif")
    result = ps4rig("export", "a.ome.tif", name)
    assert result.stdout == f"{name}: written, lengths in px, relative\n"
    data = (in_folder / name).read_bytes()
    if name == "a.ply":
        assert b"element vertex 12\n" in data
        assert b"element face 12\n" in data
    else:
        assert np.frombuffer(data, "<u4", 1, offset=80)[0] == 12
    made_set(np.zeros((4, 8, 9), np.uint16)).save("black.ome.tif")
    assert "black.ome.tif: no pixel" in refused("export", "black.ome.tif", f"b{name}", status=1)
