"""The maps of a solved set as files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from capture import CapturedSet
from capture.maps.files import write_maps
from capture.maps.map_kinds import map_views
from capture.maps.map_tiff import read_map
from capture.maps.views import SurfaceMaps
from classify import (
    Lighting,
    SurfaceEstimate,
    integrate_gradients,
    local_relief,
    relight,
    surface_curvature,
    surface_roughness,
)
from classify.base.errors import InputError

FLOAT_MAPS = {
    "p", "q", "albedo", "normals", "height", "raised", "mean_curvature", "gaussian_curvature",
    "relit", "residual",
}  # fmt: skip
MASKS = {"shadow", "dropped", "specular", "valid"}
NAMES = {
    *(f"{name}.tif" for name in (*FLOAT_MAPS, *MASKS)), *(f"{name}.png" for name in MASKS),
    "preview.png", "roughness.json", "index.html",
}  # fmt: skip
LIGHT = Lighting.from_angles([200.0], 30.0)


@pytest.fixture(scope="module")
def captured(sets: Path) -> CapturedSet:
    return CapturedSet.load(sets / "rock-001.ome.tif")


@pytest.fixture(scope="module")
def surface(captured: CapturedSet) -> SurfaceEstimate:
    return captured.solve()


@pytest.fixture(scope="module")
def maps(
    captured: CapturedSet, surface: SurfaceEstimate, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A folder with the maps of the surface, only to be read."""
    folder = tmp_path_factory.mktemp("solved") / "new" / "maps"
    paths = write_maps(captured, surface, folder, light=LIGHT)
    assert {path.name for path in paths} == NAMES == {path.name for path in folder.iterdir()}
    return folder


def test_maps_are_float32_tiffs_of_the_solved_values(surface: SurfaceEstimate, maps: Path) -> None:
    curvature = surface_curvature(surface)
    height = integrate_gradients(surface.p, surface.q)
    derived = {
        "height": height,
        "raised": local_relief(height, surface.valid),
        "mean_curvature": curvature.mean,
        "gaussian_curvature": curvature.gaussian,
        "relit": relight(surface, LIGHT)[0],
    }
    for name in FLOAT_MAPS:
        values = tifffile.imread(maps / f"{name}.tif")
        assert values.dtype == np.float32
        expected = derived[name] if name in derived else getattr(surface, name)
        if name == "normals":  # channels, as ImageJ opens them
            expected = np.moveaxis(expected, -1, 0)
        np.testing.assert_array_equal(values, np.where(surface.valid, expected, np.nan))
    assert abs(float(height.mean())) < 1e-3


@pytest.fixture
def masked(made_set: Callable[..., CapturedSet]) -> CapturedSet:
    """A plane that rises to the right; outside the mask, and in a saturated corner, noise."""
    lighting, rng = Lighting.ring(45.0), np.random.default_rng(0)
    normal = np.array([-0.2, 0.0, 1.0]) / np.sqrt(1.04)
    images = np.empty((4, 40, 60), np.uint16)
    images[:] = np.rint(40_000 * lighting.directions @ normal)[:, None, None]
    mask = np.zeros((40, 60), np.bool_)
    mask[5:35, 10:50] = True
    images[:, ~mask] = rng.integers(0, 60_000, (4, np.count_nonzero(~mask)))
    images[:, 5:9, 10:14] = 65535
    return made_set(images, mask=mask)


def test_float_maps_are_nan_where_the_surface_is_not_valid(
    masked: CapturedSet, tmp_path: Path
) -> None:
    write_maps(masked, masked.solve(), tmp_path)
    valid = tifffile.imread(tmp_path / "valid.tif") > 0
    assert np.count_nonzero(valid) == 30 * 40 - 16
    for name in FLOAT_MAPS:
        values = tifffile.imread(tmp_path / f"{name}.tif")
        np.testing.assert_array_equal(np.isfinite(values), np.broadcast_to(valid, values.shape))
    np.testing.assert_allclose(tifffile.imread(tmp_path / "p.tif")[valid], 0.2, atol=1e-3)


def test_invalid_pixels_are_grey_and_do_not_set_the_colours(masked: CapturedSet) -> None:
    maps = SurfaceMaps(masked.solve())
    views = map_views(masked, maps)
    valid = maps.surface.valid
    shown = [*views["Surface"], *views["Slopes and height"], *views["Curvature"]]
    for view in [*shown, *(each for each in views["Quality"] if each.title == "residual")]:
        assert (view.picture[~valid] == 200).all(), view.title
    ends = {view.title: view.scale.high for view in shown if view.scale}
    assert ends["p = dz/dx"] == pytest.approx(0.2, rel=0.01)
    assert ends["height (relative)"] <= np.abs(maps.height[valid]).max()


def test_png_files_show_masks_and_shadows(surface: SurfaceEstimate, maps: Path) -> None:
    valid = cv2.imread(str(maps / "valid.png"), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(valid, surface.valid * np.uint8(255))
    shadow = cv2.imread(str(maps / "shadow.png"))
    assert shadow.shape == (*surface.shape, 3)
    assert len(np.unique(shadow.reshape(-1, 3), axis=0)) == len(np.unique(surface.shadow_count))
    assert min(cv2.imread(str(maps / "preview.png")).shape[:2]) > 300


def test_masks_are_8_bit_tiffs_of_their_values(surface: SurfaceEstimate, maps: Path) -> None:
    expected = {
        "shadow": surface.shadow_count, "dropped": surface.dropped,
        "specular": surface.specular * np.uint8(255), "valid": surface.valid * np.uint8(255),
    }  # fmt: skip
    for name, mask in expected.items():
        values = tifffile.imread(maps / f"{name}.tif")
        assert values.dtype == np.uint8
        np.testing.assert_array_equal(values, mask)


def test_each_tiff_describes_its_set_and_unit(captured: CapturedSet, maps: Path) -> None:
    about = {name: read_map(maps / f"{name}.tif")[1] for name in FLOAT_MAPS | MASKS}
    with tifffile.TiffFile(maps / "p.tif") as file:
        assert json.loads(file.pages.first.description) == about["p"]
    origin = {
        "simulated": True, "label": "rock", "method": "ps4_robust",
        "pixels_sha256": captured.metadata.pixels_sha256,
    }  # fmt: skip
    assert all(each | origin == each for each in about.values())
    assert {name for name, each in about.items() if each.get("relative")} == {"height", "raised"}
    assert about["mean_curvature"]["unit"] == "1/px"
    assert about["gaussian_curvature"]["unit"] == "1/px^2"
    assert about["relit"]["light"] == {"tilt_deg": 200.0, "slant_deg": 30.0}


def test_roughness_has_units_and_marks_relative_values(
    surface: SurfaceEstimate, maps: Path
) -> None:
    written = json.loads((maps / "roughness.json").read_text())
    found = surface_roughness(surface)
    assert written["simulated"] is True
    assert written["valid_pixels"] == found.valid_pixels
    shown = [(s, e["value"], e["unit"], e["relative"]) for s, e in written["parameters"].items()]
    assert shown == [
        ("Sdq", found.sdq, "1", False), ("Sdr", found.sdr_percent, "%", False),
        ("Sa", found.sa_px, "px", True), ("Sq", found.sq_px, "px", True),
    ]  # fmt: skip


def test_a_known_scale_gives_lengths_in_mm_and_micrometres(
    captured: CapturedSet, surface: SurfaceEstimate, maps: Path, tmp_path: Path
) -> None:
    mm_per_px = 0.02
    write_maps(captured, surface, tmp_path, light=LIGHT, mm_per_px=mm_per_px)
    powers = {"height": 1, "raised": 1, "mean_curvature": -1, "gaussian_curvature": -2}
    units = {1: "mm", -1: "1/mm", -2: "1/mm^2", 0: "1"}
    for name in (*powers, "p", "q"):
        power = powers.get(name, 0)
        with tifffile.TiffFile(tmp_path / f"{name}.tif") as file:
            about = json.loads(file.pages[0].tags["ImageDescription"].value)
            values = file.asarray()
        expected = tifffile.imread(maps / f"{name}.tif") * mm_per_px**power
        rounding = 1e-5 * np.nanmax(np.abs(expected))
        np.testing.assert_allclose(values, expected, rtol=1e-5, atol=rounding)
        assert about["unit"] == units[power]
        assert about["mm_per_px"] == mm_per_px
        assert not about.get("relative", False)
    found = surface_roughness(surface)
    written = json.loads((tmp_path / "roughness.json").read_text())["parameters"]
    assert written["Sa"]["value"] == pytest.approx(1e3 * mm_per_px * found.sa_px)
    assert written["Sq"]["value"] == pytest.approx(1e3 * mm_per_px * found.sq_px)
    assert [written[each]["unit"] for each in ("Sdq", "Sdr", "Sa", "Sq")] == ["1", "%", "um", "um"]
    assert not any(each["relative"] for each in written.values())


@pytest.mark.parametrize("shape", [(4, 1, 1), (4, 3, 200), (4, 200, 3), (3, 40, 50), (9, 40, 50)])
def test_sets_of_any_shape_and_number_of_lights_have_maps(
    made_set: Callable[..., CapturedSet], tmp_path: Path, shape: tuple[int, int, int]
) -> None:
    set_ = made_set(np.full(shape, 2000, np.uint16))
    write_maps(set_, set_.solve(None if len(set_.images) == 4 else "least_squares"), tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == NAMES
    assert tifffile.imread(tmp_path / "mean_curvature.tif").shape == shape[1:]


def test_relighting_needs_exactly_one_light(
    captured: CapturedSet, surface: SurfaceEstimate, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="4 lights; give one"):
        write_maps(captured, surface, tmp_path / "maps", light=Lighting.ring(45.0))
    assert not (tmp_path / "maps").exists()


def test_no_map_replaces_an_input(
    captured: CapturedSet, surface: SurfaceEstimate, tmp_path: Path
) -> None:
    kept = tmp_path / "p.tif"
    kept.write_bytes(b"a set")
    with pytest.raises(InputError, match=r"p\.tif: is an input"):
        write_maps(captured, surface, tmp_path, inputs=[tmp_path / "set.ome.tif", kept])
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("p.tif", b"a set")]


def test_an_interrupted_solve_leaves_the_maps_of_the_set_before(
    captured: CapturedSet, surface: SurfaceEstimate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "maps"
    written = write_maps(captured, surface, folder)
    before = {path: path.read_bytes() for path in written}
    calls = iter(range(10))
    imwrite = tifffile.imwrite

    def interrupted(*arguments: Any, **options: Any) -> None:
        if next(calls) == 4:
            raise KeyboardInterrupt
        imwrite(*arguments, **options)

    monkeypatch.setattr(tifffile, "imwrite", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_maps(captured, surface, folder, light=LIGHT)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    assert list(tmp_path.iterdir()) == [folder]
