"""Calibration targets: their shapes, their places, and what a mirror shows."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.base.errors import InputError
from classify.lighting import Lighting
from rig.scene.render import render_frame
from rig.scene.surfaces import View
from rig.scene.targets import CHECKERBOARD_CORNERS, Plate, Sphere, target_named

SIDE_PX = 200
RING = Lighting.ring(45.0)
PLACES = st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))


def where(rotate_deg: float, shift_px: tuple[float, float]) -> tuple[float, float]:
    """Row and column of a target's centre, as `PeriodicSurface.patch` places a texture."""
    cos, sin = np.cos(np.radians(rotate_deg)), np.sin(np.radians(rotate_deg))
    x, y = -(cos * shift_px[0] - sin * shift_px[1]), -(sin * shift_px[0] + cos * shift_px[1])
    return 0.5 * (SIDE_PX - 1) - y, 0.5 * (SIDE_PX - 1) + x


@settings(deadline=None, max_examples=10)
@given(rotate_deg=st.floats(-180.0, 180.0), shift_px=PLACES, distance_px=st.floats(400.0, 1e4))
def test_a_mirror_sphere_shows_each_led_halfway_between_it_and_the_camera(
    rotate_deg: float, shift_px: tuple[float, float], distance_px: float
) -> None:
    ball = Sphere(60.0, mirror=True)
    scene = render_frame(
        ball, RING, SIDE_PX, rotate_deg, shift_px, led_distance_px=distance_px, gloss=ball.gloss
    )
    row, col = where(rotate_deg, shift_px)
    for direction, image in zip(RING.directions, scene.lights, strict=True):
        bright = np.maximum(image - 0.1 * image.max(), 0.0)
        rows, cols = np.indices(image.shape)
        spot = np.array([(cols * bright).sum(), (rows * bright).sum()]) / bright.sum()
        offset = np.array([spot[0] - col, row - spot[1]]) / 60.0
        normal = np.array([*offset, np.sqrt(1.0 - offset @ offset)])
        at = np.array([col - 99.5, 99.5 - row, 60.0]) + 60.0 * normal
        towards = distance_px * direction - at
        reflected = 2.0 * normal[2] * normal - (0.0, 0.0, 1.0)
        cosine = reflected @ towards / np.linalg.norm(towards)
        assert np.degrees(np.arccos(min(cosine, 1.0))) < 0.4


def test_the_rim_of_a_mirror_sphere_is_darker_than_the_card_beside_it() -> None:
    ball = Sphere(60.0, mirror=True)
    scene = ball.reflecting_room(render_frame(ball, RING, SIDE_PX, gloss=ball.gloss), 0.03)
    rim, card = scene.lights[0, 100, 157], scene.lights[0, 100, 165]
    assert 0.3 * card < rim < 0.8 * card
    assert scene.ambient[100, 100] < 0.2 * scene.ambient[70, 100]  # the camera in the middle


@settings(deadline=None, max_examples=10)
@given(rotate_deg=st.floats(-180.0, 180.0), shift_px=PLACES)
def test_a_matt_sphere_has_the_normals_of_a_sphere(
    rotate_deg: float, shift_px: tuple[float, float]
) -> None:
    scene = render_frame(Sphere(50.0, mirror=False), RING, SIDE_PX, rotate_deg, shift_px)
    row, col = where(rotate_deg, shift_px)
    rows, cols = np.indices(scene.p.shape)
    x, y = (cols - col) / 50.0, (row - rows) / 50.0
    inside = x * x + y * y < 0.95
    z = np.sqrt(1.0 - (x * x + y * y)[inside])
    np.testing.assert_allclose(scene.p[inside], -x[inside] / z, atol=1e-3)
    np.testing.assert_allclose(scene.q[inside], -y[inside] / z, atol=1e-3)
    assert np.isfinite(scene.lights).all()
    assert (scene.lights[0, (x * x + y * y) > 1.05] < 0.04).all()


@settings(deadline=None, max_examples=8)
@given(rotate_deg=st.floats(-40.0, 40.0), shift_px=PLACES, square_px=st.floats(9.0, 14.0))
def test_corners_of_the_checkerboard_are_where_they_should_be(
    rotate_deg: float, shift_px: tuple[float, float], square_px: float
) -> None:
    board = target_named("checkerboard", (SIDE_PX, SIDE_PX), 0, 5.0 / square_px)
    image = board.patch(View(SIDE_PX, rotate_deg, shift_px)).albedo
    grey = (255 * image / image.max()).astype(np.uint8)
    is_complete, corners = cv2.findChessboardCornersSB(grey, CHECKERBOARD_CORNERS)
    assert is_complete
    refined = cv2.cornerSubPix(grey, corners, (4, 4), (-1, -1), (3, 50, 1e-3))
    points = refined.reshape(-1, 2).astype(np.float64)
    row, col = where(rotate_deg, shift_px)
    np.testing.assert_allclose(points.mean(axis=0), (col, row), atol=0.15)
    across = points.reshape(6, 9, 2)[:, -1] - points.reshape(6, 9, 2)[:, 0]
    np.testing.assert_allclose(np.hypot(*across.T) / 8.0, square_px, rtol=0.01)


@settings(deadline=None, max_examples=4)
@given(st.sampled_from((90, 180, 270)))
def test_grain_dust_and_tilt_of_a_plate_turn_with_it(rotate_deg: int) -> None:
    plate, turns = Plate(seed=3), rotate_deg // 90
    still, turned = plate.patch(View(101)), plate.patch(View(101, float(rotate_deg)))
    np.testing.assert_allclose(turned.albedo, np.rot90(still.albedo, turns), atol=1e-4)
    cos, sin = round(np.cos(np.radians(rotate_deg))), round(np.sin(np.radians(rotate_deg)))
    p, q = np.rot90(still.p, turns), np.rot90(still.q, turns)
    np.testing.assert_allclose(turned.p, cos * p - sin * q, atol=1e-4)
    np.testing.assert_allclose(turned.q, sin * p + cos * q, atol=1e-4)
    np.testing.assert_allclose(turned.height, np.rot90(still.height, turns), atol=1e-2)


def test_a_plate_is_white_and_nearly_flat_and_every_seed_is_another() -> None:
    one, other = (Plate(seed).patch(View(300)) for seed in (1, 2))
    assert 0.85 < one.albedo.mean() < 0.92
    assert one.albedo.min() < 0.6  # dust
    assert 0.005 < np.hypot(one.p.mean(), one.q.mean()) < 0.02
    assert np.abs(one.p).max() < 0.1
    assert np.corrcoef(one.albedo.ravel(), other.albedo.ravel())[0, 1] < 0.1


@pytest.mark.parametrize("name", ["mirror_sphere", "matte_sphere", "checkerboard"])
def test_a_target_larger_than_the_frame_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=rf"surface {name}: .* 120 x 100 px"):
        target_named(name, (100, 120), 0, mm_per_px=0.1, size_mm=15.0)
