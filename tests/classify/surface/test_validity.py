"""Maps of photographs, and under fall-off and unknown intensities."""

import json
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from classify import Lighting, Method, SensorNoise, SurfaceEstimate, photometric_stereo

DATA = Path(__file__).parents[2] / "data"
SIDE = 96


def solved_photographs(
    name: str, lights: list[int], method: Method
) -> tuple[SurfaceEstimate, np.ndarray, np.ndarray]:
    """The surface, its object, and its backdrop without a margin of 3 px."""
    entries = json.loads((DATA / name / "lights.json").read_text())["images"]
    chosen = [entries[light] for light in lights or range(len(entries))]
    images = np.stack([cv2.imread(str(DATA / name / e["file"]), 0) for e in chosen])
    lighting = Lighting(
        np.array([e["direction"] for e in chosen]),
        np.array([e.get("intensity", 1.0) for e in chosen]),
    )
    ambient = DATA / name / "ambient.png"
    mask = cv2.imread(str(DATA / name / "mask.png"), 0) > 0
    surface = photometric_stereo(
        images, lighting, method, full_scale=255,
        ambient=cv2.imread(str(ambient), 0) if ambient.exists() else None,
    )  # fmt: skip
    return surface, mask, cv2.dilate(mask.astype(np.uint8), np.ones((7, 7))) == 0


def near_plate(
    lights: int, distance: float, intensities: np.ndarray, glints: float = 0.0
) -> tuple[np.ndarray, Lighting, np.ndarray]:
    """A matt plate under LEDs at `distance` frames, and the place of its glint."""
    rng = np.random.default_rng(0)
    lighting = Lighting.ring(45.0, np.arange(lights) * 360.0 / lights)
    y, x = (SIDE / 2.0 - np.mgrid[:SIDE, :SIDE]) * np.array([1.0, -1.0])[:, None, None]
    p, q = 0.2 * np.cos(x / 5.0) * np.sin(y / 7.0), 0.2 * np.sin(x / 5.0) * np.cos(y / 7.0)
    normals = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1 + p * p + q * q)
    places = distance * SIDE * lighting.directions[:, :, None, None]
    towards = places - np.stack([x, y, np.zeros_like(x)])
    apart = np.sqrt(np.square(towards).sum(axis=1))
    values = (towards * normals).sum(axis=1) / apart**3 * (distance * SIDE) ** 2
    values *= 150.0 * intensities[:, None, None]
    shining = rng.random(x.shape) < glints
    wrong = rng.integers(0, lights, x.shape)
    values[:, shining] *= np.where(np.arange(lights)[:, None] == wrong[shining], 2.5, 1.0)
    values += rng.normal(0.0, 1.0, values.shape)
    return np.round(np.maximum(values, 0.0)).astype(np.uint16), lighting, shining


@pytest.mark.parametrize(
    ("method", "lights"),
    [("ps4_robust", [2, 0, 10, 4]), ("ps4", [2, 0, 10, 4]), ("ps4_robust", [3, 1, 10, 9]),
     ("least_squares", []), ("drbohlav", []), ("rushmeier", [])],
)  # fmt: skip
def test_a_black_backdrop_is_neither_valid_nor_shadow(method: Method, lights: list[int]) -> None:
    """The backdrop has 4 DN under some lights and 0 under others, the object 90."""
    surface, cat, backdrop = solved_photographs("cat_crop", lights, method)
    assert surface.valid[backdrop].mean() < 0.02
    assert surface.valid[cat].mean() > 0.96
    # ps4_robust fills in slopes up to 8 px from the object.
    assert surface.shadow_mask[backdrop].mean() < (0.2 if method == "ps4_robust" else 0.02)
    assert surface.shadow_mask[cat].mean() > 0.25
    assert surface.specular[backdrop].mean() < 0.01


@pytest.mark.parametrize(
    ("method", "lights"),
    [("ps4_robust", [6, 0, 2, 4]), ("least_squares", [6, 0, 2, 4]), ("drbohlav", [])],
)
def test_a_dark_board_is_not_shadow(method: Method, lights: list[int]) -> None:
    """At slant 13, a board of 5 DN with noise of 2 has a slope error above 0.5."""
    surface, butterfly, board = solved_photographs("butterfly_crop", lights, method)
    assert surface.valid[board].mean() < 0.08
    assert surface.valid[butterfly].all()
    assert surface.shadow_mask[board].mean() < 0.08
    assert surface.specular[butterfly].mean() < 0.01


def dark_and_bright_material(albedo: float, levels: npt.ArrayLike = 1.0) -> np.ndarray:
    """Stripes of the albedo and of 220, with little noise, under LEDs of these levels."""
    x = np.arange(SIDE) / 6.0
    p = np.tile(0.4 * np.cos(x), (SIDE, 1))
    normals = np.stack([-p, np.zeros_like(p), np.ones_like(p)]) / np.sqrt(1 + p * p)
    values = np.tensordot(Lighting.ring().directions, normals, 1)
    values *= np.where(np.arange(SIDE) % 24 < 12, albedo, 220.0)[:, None]
    values *= np.reshape(levels, (-1, 1, 1))
    return (values + np.random.default_rng(0).normal(0.0, 0.3, values.shape)).astype(np.float32)


@pytest.mark.parametrize("albedo", [6.0, 10.0, 20.0])
def test_a_dark_material_beside_a_bright_one_is_valid(albedo: float) -> None:
    """Low noise: darkness alone, in light from all sides, is a surface."""
    noise = SensorNoise(gain_e_per_dn=1e9, read_noise_dn=0.3)
    images = dark_and_bright_material(albedo)
    for method in ("ps4_robust", "ps4", "least_squares", "drbohlav"):
        surface = photometric_stereo(images, Lighting.ring(), method, noise=noise)
        assert surface.valid.mean() > 0.999


def test_a_dark_material_under_a_weak_led_is_valid() -> None:
    """Its level is estimated, and the dark pixels are judged by what was found."""
    noise = SensorNoise(gain_e_per_dn=1e9, read_noise_dn=0.3)
    images = dark_and_bright_material(10.0, (1.0, 1.0, 1.0, 0.25))
    surface = photometric_stereo(images, Lighting.ring(), noise=noise)
    assert surface.valid.mean() > 0.999


@pytest.mark.parametrize("distance", [5.0, 2.0])
@pytest.mark.parametrize(
    ("method", "lights"),
    [("ps4_robust", 4), ("least_squares", 4), ("least_squares", 8), ("rushmeier", 8),
     ("drbohlav", 24), ("least_squares", 72), ("rushmeier", 72)],
)  # fmt: skip
def test_fall_off_is_not_gloss(method: Method, lights: int, distance: float) -> None:
    """A near LED at two frames gives three times as much in the nearest corner."""
    images, lighting, _ = near_plate(lights, distance, np.ones(lights))
    surface = photometric_stereo(images, lighting, method)
    assert surface.specular.mean() < 0.07
    assert surface.valid.mean() > 0.99
    assert surface.shadow_mask.mean() < 0.01


@pytest.mark.parametrize("method", ["least_squares", "rushmeier", "drbohlav"])
def test_unknown_intensities_are_not_gloss_but_glints_are(method: Method) -> None:
    """Of 24 lights held by hand, as in RTI."""
    intensities = np.random.default_rng(2).lognormal(0.0, 0.2, 24)
    images, lighting, glints = near_plate(24, 5.0, intensities, glints=0.05)
    surface = photometric_stereo(images, lighting, method)
    assert surface.specular[~glints].mean() < 0.02
    if method != "drbohlav":  # which leaves out no light where most do not agree
        assert surface.specular[glints].mean() > 0.95
