"""Saturated and dark images are rejected by name and cause."""

import numpy as np
import pytest

from capture import SetRejected
from capture.acquisition.light_checks import check_images, check_set
from capture.sets.image_checks import CheckedImages
from classify import Calibration, Lighting

NAMES = ("LED 0", "LED 1", "LED 2", "LED 3")
TOP = 4095


def check(levels: tuple[float, ...], ambient: float = 80.0, saturated_pixels: int = 0) -> None:
    images = np.stack([np.full((20, 50), level, np.uint16) for level in levels])
    images[1].flat[:saturated_pixels] = TOP
    dark = np.full((20, 50), ambient, np.uint16)
    check_images(CheckedImages(images, dark, None, Lighting.ring(45.0), NAMES, TOP, None))


def test_even_light_with_one_percent_of_saturated_pixels_passes() -> None:
    check((2000, 1800, 2100, 1500), saturated_pixels=10)  # 1 % of 1000


@pytest.mark.parametrize(
    ("levels", "ambient", "saturated_pixels", "message"),
    [
        ((2000,) * 4, 80, 11, r"LED 1: 1\.1% .*saturated \(limit 1%\)"),
        ((2000, 2000, 1005, 2000), 1000, 0, r"LED 2: dark, 5\.0 of 4095"),
        ((50, 2000, 2000, 2000), 80, 0, r"LED 0: dark, -30\.0 of 4095"),
        ((2080, 1080, 2080, 180), 80, 0, r"LED 3: only 5% .*\(limit 10%\)"),
    ],
    ids=["saturated", "dark", "below ambient", "weak"],
)
def test_a_saturated_dark_or_weak_image_is_rejected_with_its_value(
    levels: tuple[float, ...], ambient: float, saturated_pixels: int, message: str
) -> None:
    with pytest.raises(SetRejected, match=f"^set rejected: {message}"):
        check(levels, ambient, saturated_pixels)


def test_an_ambient_image_that_is_a_light_image_is_named_as_such() -> None:
    images = np.random.default_rng(0).integers(500, 2000, (4, 20, 50), np.uint16)
    lighting = Lighting.ring(45.0)
    repeated = CheckedImages(images, images[2].copy(), None, lighting, NAMES, TOP, None)
    with pytest.raises(SetRejected, match=r"under LED 2 and ambient light are the same in 20 of"):
        check_set(repeated, Calibration(), lambda: images)


def test_all_causes_are_named_at_once() -> None:
    with pytest.raises(SetRejected) as caught:
        check((4095, 2000, 2100, 2050), ambient=2048)
    causes = str(caught.value).removeprefix("set rejected: ").split("; ")
    assert causes[0].startswith("ambient light fills 50%")
    assert [cause for cause in causes if cause.startswith("LED 0: 100.0% of the pixels")]
    assert sum(": dark, " in cause for cause in causes) == 2
    assert caught.value.exit_status == 1
