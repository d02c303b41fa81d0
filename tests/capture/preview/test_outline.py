"""The outline of a part, turned: a hand that follows it places the part within 2 degrees."""

import xml.etree.ElementTree as ET
from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from capture import CapturedSet
from capture.session.live_view import Outline

MakeSet = Callable[..., CapturedSet]
SIDE_PX = 256
# A leaf without symmetry, in shares of the frame from its middle.
CORNERS = np.array([(-0.25, -0.2), (0.3, -0.1), (0.12, 0.02), (0.22, 0.24), (-0.1, 0.12)])


def part_mask(orientation_deg: float, shift_px: float = 0.0) -> npt.NDArray[np.bool_]:
    angle = np.radians(orientation_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = SIDE_PX * (CORNERS * (1.0, -1.0)) @ turn * (1.0, 1.0) + (SIDE_PX - 1) / 2.0
    mask = np.zeros((SIDE_PX, SIDE_PX), np.uint8)
    # 4 binary places.
    cv2.fillPoly(mask, [np.rint(16.0 * (corners + shift_px)).astype(np.int32)], 1, shift=4)
    return mask.astype(np.bool_)


def photographed(made_set: MakeSet, orientation_deg: float, *, ground: float) -> CapturedSet:
    """A rough part on a ground of another brightness, in noise."""
    rng = np.random.default_rng(3)
    relief = cv2.GaussianBlur(rng.normal(size=(SIDE_PX, SIDE_PX)), (0, 0), 2.0)
    mask = part_mask(orientation_deg)
    images = []
    for light in range(4):
        shading = 0.5 + 0.6 * np.roll(relief, light) + 0.02 * rng.normal(size=relief.shape)
        images.append(np.where(mask, shading, ground + 0.02 * rng.normal(size=relief.shape)))
    pixels = (60_000 * np.clip(images, 0.01, 0.99)).astype(np.uint16)
    return made_set(pixels)


def gap_px(outline: Outline, mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Distances of the drawn line from the border of a part."""
    drawn = np.zeros(mask.shape, np.uint8)
    cv2.polylines(drawn, [np.rint(line).astype(np.int32) for line in outline.lines], True, 1)
    border = mask & ~cv2.erode(mask.astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
    distance = cv2.distanceTransform((~border).astype(np.uint8), cv2.DIST_L2, 5)
    return distance[drawn > 0]


@pytest.mark.parametrize("ground", [0.05, 0.95])
@pytest.mark.parametrize("angle_deg", [0.0, 40.0, -135.0])
def test_the_turned_outline_lies_on_the_turned_part(
    made_set: MakeSet, angle_deg: float, ground: float
) -> None:
    outline = Outline.of(photographed(made_set, 0.0, ground=ground))
    assert len(outline.lines) == 1
    turned = outline.rotated(angle_deg)
    assert np.percentile(gap_px(turned, part_mask(angle_deg)), 95) < 2.5
    # The hand leaves the least gap.
    tried = np.arange(-10.0, 10.1, 0.5)
    gaps = [gap_px(turned, part_mask(angle_deg + off)).mean() for off in tried]
    assert abs(tried[int(np.argmin(gaps))]) <= 1.0
    # Two degrees off, the ends of the part are more than twice as far from the line.
    there, aside = (
        np.percentile(gap_px(turned, part_mask(angle_deg + off_deg)), 98) for off_deg in (0.0, 2.0)
    )
    assert aside > 2.0 * there


def test_a_mask_of_the_set_is_its_outline(made_set: MakeSet) -> None:
    mask = part_mask(20.0)
    flat = np.full((4, SIDE_PX, SIDE_PX), 20_000, np.uint16)
    outline = Outline.of(made_set(flat, mask=mask))
    assert gap_px(outline, mask).max() <= 1.5


def test_a_texture_that_fills_the_frame_is_drawn_by_its_edges(made_set: MakeSet) -> None:
    rng = np.random.default_rng(8)
    relief = [cv2.GaussianBlur(rng.normal(size=(SIDE_PX, SIDE_PX)), (0, 0), 3.0) for _ in range(4)]
    pixels = (30_000 + 100_000 * np.array(relief)).clip(0, 65535).astype(np.uint16)
    outline = Outline.of(made_set(pixels))
    assert 5 < len(outline.lines) <= 300


@pytest.mark.parametrize("value", [0, 30_000])
def test_an_even_frame_has_no_outline(made_set: MakeSet, value: int) -> None:
    outline = Outline.of(made_set(np.full((4, 64, 64), value, np.uint16)))
    assert outline.lines == ()
    assert ET.fromstring(outline.svg()).tag.endswith("svg")


def test_the_image_has_the_size_of_the_frame_and_closed_lines() -> None:
    line = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 5.0)], np.float32)
    svg = ET.fromstring(Outline(20, 10, (line,)).svg())
    assert svg.attrib["viewBox"] == "0 0 20 10"
    assert [path.attrib["d"] for path in svg] == ["M0.5 0.5L10.5 0.5L10.5 5.5Z"] * 2
    # A quarter turn anticlockwise about the middle of a frame of 21 x 11 px.
    turned = Outline(21, 11, (line,)).rotated(90.0)
    np.testing.assert_allclose(turned.lines[0], [(5.0, 15.0), (5.0, 5.0), (10.0, 5.0)], atol=1e-4)
