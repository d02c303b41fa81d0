"""The page of maps: complete, self-contained, and text of a set is escaped."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from capture import CapturedSet
from capture.maps.files import map_page
from capture.maps.map_kinds import map_views
from capture.maps.views import SurfaceMaps
from tests.html_page import Page


def page_of(
    captured: CapturedSet,
    method: str = "ps4",
    *,
    planar: bool = False,
    mm_per_px: float | None = None,
) -> Page:
    maps = SurfaceMaps(captured.solve(method, planar=planar), mm_per_px=mm_per_px)
    page = Page(map_page(captured, maps, map_views(captured, maps)))
    assert page.open == []
    return page


@pytest.fixture(scope="module")
def page(sets: Path) -> Page:
    return page_of(CapturedSet.load(sets / "rock-001.ome.tif"))


def test_the_page_says_that_a_part_was_solved_as_planar(
    page: Page, sets: Path, made_set: Callable[..., CapturedSet]
) -> None:
    planar = page_of(CapturedSet.load(sets / "rock-001.ome.tif"), planar=True).text
    assert re.search(r"fall-off of \d+%", planar)
    assert "planar" not in page.text
    assert "too little of it" in page_of(made_set(np.zeros((4, 9, 9), np.uint16)), planar=True).text


def test_the_page_shows_every_map_with_its_name(page: Page) -> None:
    titles = [image["alt"] for image in page.all("img")]
    # The mask of gloss has one value, and no picture.
    assert len(titles) == len(set(titles)) == 4 + 4 + 4 + 2 + 5 - 1
    assert "no 100.0%" in page.text
    assert "specular.png" in page.text
    for name in (
        "p.tif", "q.tif", "albedo.tif", "normals.tif", "height.tif", "raised.tif",
        "mean_curvature.tif", "gaussian_curvature.tif", "relit.tif", "residual.tif",
        "shadow.png", "dropped.png", "valid.png", "roughness.json",
    ):  # fmt: skip
        assert name in page.text


def test_the_page_states_set_method_and_units(page: Page) -> None:
    assert "Simulated. No light" in page.text
    facts = ("rock", "ps4", "128 x 128 px, 12 bit", "4, slant 45.0°", "1/px²", "(relative)")
    for fact in (*facts, "Sdq", "Sdr", "Sa", "Sq"):
        assert fact in page.text


def test_the_page_says_relative_only_where_the_scale_is_unknown(page: Page, sets: Path) -> None:
    scaled = page_of(CapturedSet.load(sets / "rock-001.ome.tif"), mm_per_px=0.02).text
    assert "elative" in page.text
    assert "mm" not in page.text
    assert "elative" not in scaled
    for unit in ("0.02 mm/px", "height, mm", "1/mm²", "\N{MICRO SIGN}m"):
        assert unit in scaled


def test_colour_bars_run_from_lowest_to_highest(made_set: Callable[..., CapturedSet]) -> None:
    """On a plane with p = 0.2 everywhere the scale ends at -0.2 and 0.2."""
    set_ = made_set(np.full((4, 8, 8), 1000, np.uint16))
    normal = np.array([-0.2, 0.0, 1.0]) / np.sqrt(1.04)
    levels = np.rint(40_000 * set_.lighting.directions @ normal).astype(np.uint16)
    text = page_of(made_set(np.tile(levels[:, None, None], (1, 8, 8)))).text
    assert "\N{MINUS SIGN}0.200.2p = dz/dx" in text
    assert "Simulated" not in text
    assert "without a label" not in text


def test_warnings_mask_and_crop_of_an_import_are_shown(
    made_set: Callable[..., CapturedSet],
) -> None:
    images, mask = np.full((4, 8, 8), 1000, np.uint16), np.zeros((8, 8), np.bool_)
    mask[:2] = True
    warnings = ("light-order: <exchanged>", "12 bits, guessed")
    text = page_of(made_set(images, mask=mask, crop=(3, 5, 8, 8), warnings=warnings)).text
    assert all(f"Warning at import: {warning}" in text for warning in warnings)
    assert "mask.png, 25.0%" in text
    assert "from column 3, row 5" in text
    assert "Warning" not in page_of(made_set(images)).text


def test_a_set_without_label_or_valid_pixel_is_shown(made_set: Callable[..., CapturedSet]) -> None:
    text = page_of(made_set(np.zeros((4, 1, 1), np.uint16), label=None)).text
    assert "without a label" in text
    assert "root mean square gradient-" in text


def test_only_eight_of_fifty_light_images_are_shown(made_set: Callable[..., CapturedSet]) -> None:
    page = page_of(made_set(np.full((50, 8, 8), 1000, np.uint16)), "least_squares")
    titles = [image["alt"] or "" for image in page.all("img")]
    assert sum("light" in title and "tilt" in title for title in titles) == 8
    assert "(the first 8 of 50)" in page.text
    assert "light 7 of 50: tilt 50" in page.text
