"""Rotated or mirrored images give the rotated or mirrored surface."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import METHODS, Lighting, Method, SurfaceEstimate, photometric_stereo
from classify.lights.agreement import light_agreement
from classify.lights.order import light_order
from classify.relief.relighting import cast_shadow

DATA = Path(__file__).parents[2] / "data"
# Quarter turns anticlockwise, and whether the result is mirrored left to right.
SYMMETRIES = [(turns, mirrored) for turns in range(4) for mirrored in (False, True)][1:]
# The light that each version of PS3 leaves out.
PS3_TILTS = {"ps3a": 270, "ps3b": 0, "ps3c": 90, "ps3d": 180}
MORE_LIGHTS: tuple[Method, ...] = ("least_squares", "rushmeier", "drbohlav")


def photographs(name: str, lights: list[int]) -> tuple[np.ndarray, Lighting, np.ndarray | None]:
    entries = json.loads((DATA / name / "lights.json").read_text())["images"]
    chosen = [entries[light] for light in lights or range(len(entries))]
    images = np.stack([cv2.imread(str(DATA / name / e["file"]), 0) for e in chosen])
    intensities = np.array([e.get("intensity", 1.0) for e in chosen])
    lighting = Lighting(np.array([e["direction"] for e in chosen]), intensities)
    ambient = DATA / name / "ambient.png"
    return images, lighting, cv2.imread(str(ambient), 0) if ambient.exists() else None


def rotated_frame(values: np.ndarray, turns: int, mirrored: bool) -> np.ndarray:
    values = np.rot90(values, turns, axes=(-2, -1))
    return np.ascontiguousarray(values[..., ::-1] if mirrored else values)


def rotated_vectors(
    x: np.ndarray, y: np.ndarray, turns: int, mirrored: bool
) -> tuple[np.ndarray, np.ndarray]:
    for _ in range(turns):
        x, y = -y, x
    return (-x if mirrored else x), y


def rotated_method(method: Method, turns: int, mirrored: bool) -> Method:
    """The version of PS3 that leaves out the same image."""
    if method not in PS3_TILTS:
        return method
    tilt = (PS3_TILTS[method] + 90 * turns) % 360
    tilt = (180 - tilt) % 360 if mirrored else tilt
    return next(name for name, unused in PS3_TILTS.items() if unused == tilt)


def assert_no_direction_is_preferred(
    images: np.ndarray, lighting: Lighting, method: Method, ambient: np.ndarray | None = None
) -> SurfaceEstimate:
    surface = photometric_stereo(images, lighting, method, ambient=ambient)
    for symmetry in SYMMETRIES:
        x, y = rotated_vectors(*lighting.directions.T[:2], *symmetry)
        other = photometric_stereo(
            rotated_frame(images, *symmetry),
            Lighting(np.stack([x, y, lighting.directions[:, 2]], axis=1), lighting.intensities),
            rotated_method(method, *symmetry),
            ambient=None if ambient is None else rotated_frame(ambient, *symmetry),
        )
        p, q = rotated_vectors(
            rotated_frame(surface.p, *symmetry), rotated_frame(surface.q, *symmetry), *symmetry
        )
        # Steeper slopes are divided by smaller numbers; slopes that are filled in add up rounding.
        rounding = np.where(rotated_frame(surface.repaired, *symmetry), 2e-3, 1e-4)
        rounding *= 1.0 + p * p + q * q
        assert (np.abs(other.p - p) < rounding).mean() > 0.999
        assert (np.abs(other.q - q) < rounding).mean() > 0.999
        for name in ("valid", "repaired", "dropped", "shadow_count", "specular"):
            same = getattr(other, name) == rotated_frame(getattr(surface, name), *symmetry)
            # Values at a limit may be rounded to either side of it.
            assert same.mean() > 0.998, name
    return surface


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=4)
@given(
    rows=st.integers(25, 60), columns=st.integers(25, 60), seed=st.integers(0, 1000),
    rounded=st.booleans(),
)  # fmt: skip
def test_solvers_are_symmetric_on_relief_with_shadow_and_noise(
    method: Method, rows: int, columns: int, seed: int, rounded: bool
) -> None:
    rng = np.random.default_rng(seed)
    five = method == "rushmeier"
    lighting = Lighting.ring(60.0, np.arange(5) * 72.0) if five else Lighting.ring(60.0)
    x, y = np.meshgrid(np.arange(columns), -np.arange(rows))
    height = sum(
        2.5 * np.sin((x * np.cos(angle) + y * np.sin(angle)) / 5.0 + phase)
        for angle, phase in rng.uniform(0.0, np.pi, (4, 2))
    )
    rows_down, p = np.gradient(height)
    normals = np.stack([-p, rows_down, np.ones_like(p)]) / np.sqrt(1 + p * p + rows_down**2)
    values = 200.0 * rng.uniform(0.5, 1.0, p.shape) * np.tensordot(lighting.directions, normals, 1)
    for value, direction in zip(values, lighting.directions, strict=True):
        value[cast_shadow(height.astype(np.float32), direction)] = 0.0
    values = np.maximum(values, 0.0) + rng.normal(0.0, 1.5, values.shape)
    images = np.round(values + 10.0).astype(np.uint8) if rounded else values.astype(np.float32)
    ambient = np.full(p.shape, 10, np.uint8) if rounded else None
    surface = assert_no_direction_is_preferred(images, lighting, method, ambient)
    assert surface.shadow_mask.mean() > 0.05


@pytest.mark.parametrize("method", ["ps4", "least_squares", "drbohlav", "ps4_robust"])
@pytest.mark.parametrize(
    ("name", "lights"), [("butterfly_crop", [6, 0, 2, 4]), ("cat_crop", [2, 0, 10, 4])]
)
def test_solvers_are_symmetric_on_photographs(method: Method, name: str, lights: list[int]) -> None:
    images, lighting, ambient = photographs(name, lights)
    assert_no_direction_is_preferred(images, lighting, method, ambient)


@pytest.mark.parametrize("method", MORE_LIGHTS)
def test_solvers_are_symmetric_under_twelve_lights(method: Method) -> None:
    images, lighting, _ = photographs("cat_crop", [])
    assert_no_direction_is_preferred(images, lighting, method)


@pytest.mark.parametrize(
    ("name", "lights"), [("butterfly_crop", [6, 0, 2, 4]), ("cat_crop", [3, 1, 10, 9])]
)
@pytest.mark.parametrize(("rows", "columns"), [(128, 127), (115, 106)])
def test_checks_of_the_lights_are_symmetric(
    name: str, lights: list[int], rows: int, columns: int
) -> None:
    """Their order and their agreement, in frames of even and odd sides."""
    images, lighting, ambient = photographs(name, lights)
    images = images[:, :rows, :columns].astype(np.uint16)
    dark = np.zeros_like(images[0]) if ambient is None else ambient[:rows, :columns]
    dark = dark.astype(np.uint16)
    order = light_order(images, lighting, ambient=dark)
    agreement = light_agreement(images, lighting, dark, 255, None)
    assert agreement.redundancy_residual > 0.01
    for symmetry in SYMMETRIES:
        x, y = rotated_vectors(*lighting.directions.T[:2], *symmetry)
        other = Lighting(np.stack([x, y, lighting.directions[:, 2]], 1), lighting.intensities)
        frames, no_light = rotated_frame(images, *symmetry), rotated_frame(dark, *symmetry)
        rotated_order = light_order(frames, other, ambient=no_light)
        assert set(rotated_order.plausible) == set(order.plausible)
        assert rotated_order.excess == pytest.approx(order.excess, abs=1e-3)
        found = light_agreement(frames, other, no_light, 255, None)
        assert found.redundancy_residual == pytest.approx(agreement.redundancy_residual, rel=1e-3)
        assert (found.levels is None) == (agreement.levels is None)
