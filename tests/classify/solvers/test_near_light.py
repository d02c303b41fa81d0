"""Lights at positions, and images divided by a flat field."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import InputError, Lighting, Method, SurfaceEstimate, photometric_stereo, relight
from classify.classifiers.thesis import images_of
from classify.images import ImageStack, SensorNoise
from classify.lights.flat_field import FlatField
from classify.lights.near_light import Shear, coordinates_px, sheet_of
from classify.solvers.problem import Problem
from classify.solvers.robust import solve_ps4_robust

SHAPE = (48, 64)
FOUR_LIGHTS: tuple[Method, ...] = ("ps3a", "ps4", "ps4_robust", "least_squares", "drbohlav")
MORE_LIGHTS: tuple[Method, ...] = ("least_squares", "rushmeier", "drbohlav")
RING = Lighting.ring(45.0)
SIX = Lighting.from_angles([0, 60, 120, 180, 240, 300], [45, 30, 40, 45, 50, 35])


def slopes(seed: int, steepness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """p, q and albedo that differ from pixel to pixel."""
    rng = np.random.default_rng(seed)
    p, q = rng.uniform(-steepness, steepness, (2, *SHAPE))
    return p, q, rng.uniform(0.3, 0.9, SHAPE)


def lit_by(
    lighting: Lighting, p: np.ndarray, q: np.ndarray, albedo: np.ndarray, lobe: float = 0.0
) -> np.ndarray:
    """Images by Lambert's law and the inverse square; negative where facing away.

    The strength at the middle of the frame is the intensity of the light.
    """
    x, y = np.meshgrid(*coordinates_px(SHAPE))
    normal = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1.0 + p * p + q * q)
    images = []
    for position, intensity in zip(lighting.positions_px, lighting.intensities, strict=True):
        towards = position[:, None, None] - np.stack([x, y, np.zeros_like(x)])
        distance, far = np.linalg.norm(towards, axis=0), np.linalg.norm(position)
        cosine = (normal * towards).sum(axis=0) / distance
        axis = (position[:, None, None] * towards).sum(axis=0) / (far * distance)
        images.append(intensity * albedo * cosine * (far / distance) ** 2 * axis**lobe)
    return np.array(images, np.float32)


def assert_is(
    surface: SurfaceEstimate, p: np.ndarray, q: np.ndarray, albedo: np.ndarray, within: float
) -> None:
    assert surface.valid.all()
    np.testing.assert_allclose(surface.p, p, atol=within)
    np.testing.assert_allclose(surface.q, q, atol=within)
    np.testing.assert_allclose(surface.albedo, albedo, rtol=within)


def near(lighting: Lighting, distances: npt.ArrayLike) -> Lighting:
    """Lights of these directions, at distances in fields of view."""
    lengths = SHAPE[1] * np.broadcast_to(distances, len(lighting))
    return Lighting.near(lengths[:, None] * lighting.directions, np.ones(len(lighting)))


@settings(max_examples=20)
@given(data=st.data(), lights=st.sampled_from([3, 4, 6, 9]), seed=st.integers(0, 99))
def test_least_squares_finds_the_surface_under_lights_at_any_positions(
    data: st.DataObject, lights: int, seed: int
) -> None:
    tilts = [data.draw(st.floats(-10.0, 10.0)) + 360.0 * k / lights for k in range(lights)]
    slants = [data.draw(st.floats(25.0, 55.0)) for _ in tilts]
    distances = [data.draw(st.floats(1.5, 8.0)) for _ in tilts]
    lighting = near(Lighting.from_angles(tilts, slants), distances)
    truth = slopes(seed, 0.25)  # every light reaches every pixel
    surface = photometric_stereo(lit_by(lighting, *truth), lighting, "least_squares")
    assert_is(surface, *truth, within=1e-4)
    assert surface.residual.max() < 1e-5


@settings(max_examples=15)
@given(
    slant=st.floats(30.0, 50.0),
    height=st.floats(1.0, 8.0),
    tilt=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
    turn=st.floats(-20.0, 20.0),
    seed=st.integers(0, 99),
)
@pytest.mark.parametrize("method", FOUR_LIGHTS)
def test_four_lights_of_one_plane_give_the_exact_surface(
    method: Method, slant: float, height: float, tilt: tuple, turn: float, seed: int
) -> None:
    directions = Lighting.from_angles([turn, 85.0, 180.0, 275.0], slant).directions
    # c . P = 1
    plane = np.array([*tilt, 1.0]) / (height * SHAPE[1])
    lighting = Lighting.near(directions / (directions @ plane)[:, None], np.ones(4))
    np.testing.assert_allclose(Shear.of(lighting).excess, 0.0, atol=1e-9)
    truth = slopes(seed, 0.3)
    surface = photometric_stereo(lit_by(lighting, *truth), lighting, method)
    assert_is(surface, *truth, within=1e-4)


@pytest.mark.parametrize("method", FOUR_LIGHTS)
@pytest.mark.parametrize("fields", [2.0, 5.0])
def test_four_lights_out_of_one_plane_give_the_exact_surface(method: Method, fields: float) -> None:
    lighting = near(Lighting.from_angles([3, 88, 182, 275], [42, 48, 45, 40]), fields)
    lighting = Lighting.near(lighting.positions_px * [[1.0], [1.1], [0.95], [1.05]], np.ones(4))
    truth = slopes(0, 0.3)
    surface = photometric_stereo(lit_by(lighting, *truth), lighting, method)
    assert_is(surface, *truth, within=1e-4)


@pytest.mark.parametrize("unequal", [1.02, 1.1])
@pytest.mark.parametrize(
    ("method", "directions"),
    [("ps4", RING), ("ps4_robust", RING), ("drbohlav", SIX), ("rushmeier", SIX)],
)
def test_lights_out_of_one_plane_give_the_surface_in_shadow_as_well(
    method: Method, directions: Lighting, unequal: float
) -> None:
    lighting = near(directions, 3.0 * np.where(np.arange(len(directions)) % 2, unequal, 1.0))
    p, q, albedo = slopes(2, 0.3)
    images = lit_by(lighting, p, q, albedo)
    rng = np.random.default_rng(0)
    shadowed = rng.random(SHAPE) < 0.1
    images[rng.integers(len(images)), shadowed] *= 0.02
    surface = photometric_stereo(images, lighting, method)
    assert surface.valid.mean() > 0.99
    error = np.hypot(surface.p - p, surface.q - q)
    assert error[surface.valid & ~shadowed].max() < 1e-4
    assert error[surface.valid & shadowed].mean() < 4e-3


def test_strips_of_one_row_give_the_surface_of_the_whole_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lighting = near(RING, 2.0 * np.array([1.0, 1.1, 0.95, 1.05]))
    images = lit_by(lighting, *slopes(4, 0.3))
    images[0, :, ::5] *= 0.02
    stack = ImageStack(images, None)
    problem = Problem(stack, lighting, None, SensorNoise(1e9, 1e-4), np.float32(np.inf))
    whole = solve_ps4_robust(problem)
    monkeypatch.setattr("classify.solvers.strips.STRIP_PX", SHAPE[1])
    monkeypatch.setattr("classify.solvers.unsolved.PART_PIXELS", 8)
    rows = solve_ps4_robust(problem)
    for name in ("p", "q", "albedo", "valid"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(rows, name))


@pytest.mark.parametrize("lighting", [near(RING, 2.0), near(SIX, 2.0)])
def test_every_map_is_that_of_the_near_lights(lighting: Lighting) -> None:
    truth = slopes(3, 0.35)
    images = np.maximum(lit_by(lighting, *truth), 0.0)
    cast = np.zeros(images.shape, np.bool_)
    cast[1, 10:20, 50:60] = True
    images[cast] = 0.0
    images[2, 30, 10] *= 4.0
    surface = photometric_stereo(images, lighting)
    lit = ~cast.any(axis=0)
    lit[30, 10] = False
    assert surface.residual[lit].max() < 1e-5
    assert surface.residual[~lit].min() > 0.01
    assert not surface.shadow_mask[lit].any()
    assert surface.shadow_mask[cast.any(axis=0)].all()
    assert not surface.specular[lit].any()
    assert not surface.saturated.any()
    above = relight(surface, Lighting.from_angles([0.0], 0.0))[0]
    p, q, albedo = truth
    np.testing.assert_allclose(above[lit], (albedo / np.sqrt(1 + p * p + q * q))[lit], rtol=1e-3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_saturated_pixels_stay_saturated(dtype: type) -> None:
    lighting = near(RING, 2.0)
    full_scale = np.iinfo(dtype).max
    p, q, _ = slopes(4, 0.2)
    values = lit_by(lighting, p, q, np.full(SHAPE, 0.5))
    values[0, :8] = 1.0
    ambient = np.full(SHAPE, 0.02 * full_scale).astype(dtype)
    images = np.minimum(np.rint(values * 0.9 * full_scale) + ambient, full_scale).astype(dtype)
    images[0, :8] = full_scale
    for planar in (False, True):
        surface = photometric_stereo(
            images, lighting, "ps4", ambient=ambient, full_scale=full_scale, planar=planar
        )
        np.testing.assert_array_equal(surface.saturated, images[0] == full_scale)
        assert not surface.valid[:8].any()
        assert surface.valid[8:].all()
    surface = photometric_stereo(images, lighting, ambient=ambient, full_scale=full_scale)
    assert np.abs(surface.p - p)[8:].mean() < (0.01 if dtype is np.uint8 else 1e-4)


@pytest.mark.parametrize("method", FOUR_LIGHTS)
def test_lights_far_away_are_distant_lights(method: Method) -> None:
    images = np.maximum(lit_by(near(RING, 1e6), *slopes(5, 1.5)), 0.0)
    expected = photometric_stereo(images, RING, method)
    surface = photometric_stereo(images, near(RING, 1e6), method)
    assert (surface.valid == expected.valid).mean() > 0.999
    for name in ("p", "q", "albedo", "residual"):
        np.testing.assert_allclose(
            getattr(surface, name), getattr(expected, name), rtol=1e-2, atol=2e-4
        )


def test_lobes_are_divided_out_without_a_flat_field() -> None:
    lighting = near(Lighting.from_angles([0, 90, 180, 270], [40, 45, 50, 45]), 2.0)
    p, q, albedo = slopes(7, 0.3)
    images = lit_by(lighting, p, q, albedo, lobe=8.0)
    surface = photometric_stereo(images, lighting, lobe_exponent=8.0)
    assert_is(surface, p, q, albedo, within=2e-4)


def test_the_lobe_of_an_led_and_its_level_are_in_the_sheet() -> None:
    lighting = near(Lighting.from_angles([0, 90, 180, 270], [40, 45, 50, 45]), 2.0)
    lighting = replace(lighting, intensities=np.array([1.0, 0.8, 1.1, 0.95]))
    flat = np.zeros(SHAPE)
    sheet = lit_by(lighting, flat, flat, np.ones(SHAPE), lobe=1.5)
    found = sheet_of(lighting, SHAPE, 1.5).strengths(*map(np.arange, SHAPE), SHAPE)
    ratio = sheet / found
    np.testing.assert_allclose(ratio, ratio[0, 0, 0], rtol=1e-5)
    truth = slopes(6, 0.3)
    surface = photometric_stereo(
        lit_by(lighting, *truth, lobe=1.5), lighting, flat_field=sheet_of(lighting, SHAPE, 1.5)
    )
    assert np.abs(surface.p - truth[0]).max() < 1e-4
    assert np.abs(surface.q - truth[1]).max() < 1e-4


def test_levels_that_are_not_given_are_estimated_under_near_lights() -> None:
    lighting = near(RING, 3.0)
    levels = np.array([1.0, 0.95, 1.0, 1.05])
    truth = slopes(7, 0.3)
    images = lit_by(replace(lighting, intensities=levels), *truth)
    surface = photometric_stereo(images, Lighting.near(lighting.positions_px), "ps4_robust")
    np.testing.assert_allclose(surface.led_levels / surface.led_levels[0], levels, atol=5e-3)
    assert np.abs(surface.p - truth[0]).max() < 5e-3


def test_a_rotated_frame_under_rotated_near_lights_is_the_rotated_surface() -> None:
    lighting = near(Lighting.from_angles([3, 88, 182, 275], [42, 48, 45, 40]), [2, 2.2, 2.1, 2.4])
    images = np.maximum(lit_by(lighting, *slopes(8, 0.8)), 0.0)
    surface = photometric_stereo(images, lighting)
    x, y, z = lighting.positions_px.T
    rotated = photometric_stereo(
        np.rot90(images, axes=(1, 2)).copy(), Lighting.near(np.stack([-y, x, z], 1), np.ones(4))
    )
    np.testing.assert_allclose(rotated.p, -np.rot90(surface.q), atol=1e-3)
    np.testing.assert_allclose(rotated.q, np.rot90(surface.p), atol=1e-3)


def test_the_fall_off_of_a_planar_part_is_found_beside_that_of_near_lights() -> None:
    lighting = near(RING, 3.0)
    p, q, albedo = slopes(9, 0.3)
    p -= p.mean()
    q -= q.mean()
    surface = photometric_stereo(lit_by(lighting, p + 0.1, q, albedo), lighting, planar=True)
    assert abs(surface.p.mean()) < 0.02
    assert np.corrcoef(surface.p.ravel(), p.ravel())[0, 1] > 0.99
    assert surface.fall_off is not None


def test_images_divided_by_the_sheet_give_its_slope_and_levels() -> None:
    slants, levels = [40.0, 50.0, 45.0, 45.0], np.array([1.0, 0.8, 1.1, 0.95])
    lighting = Lighting.from_angles([0.0, 90.0, 180.0, 270.0], slants)
    coefficients = np.zeros((4, 3, 3))
    coefficients[:, 0, 0] = np.log(levels * lighting.directions[:, 2])
    coefficients[0, 0, 1], coefficients[1, 1, 0], coefficients[2, 1, 1] = 0.1, 0.2, -0.1
    coefficients[3, 0, 2], coefficients[3, 1, 0] = -0.2, 1.0
    flat_field = FlatField(coefficients, np.tile([-9.0, 9.0], (4, 1)))
    sheet = flat_field.strengths(np.arange(30), np.arange(40), (30, 40))
    flat = photometric_stereo(sheet.astype(np.float32), lighting, flat_field=flat_field)
    assert np.abs(flat.p).max() < 1e-5
    assert np.abs(flat.q).max() < 1e-5
    assert np.ptp(flat.albedo) < 1e-5
    tilted = sheet * (lighting.directions @ [-0.3, 0.1, 1.0])[:, None, None]
    tilted /= lighting.directions[:, 2, None, None]
    surface = photometric_stereo(tilted.astype(np.float32), lighting, "ps4", flat_field=flat_field)
    np.testing.assert_allclose(surface.p, 0.3, atol=1e-5)
    np.testing.assert_allclose(surface.q, -0.1, atol=1e-5)
    assert surface.residual.max() < 1e-5
    assert surface.led_levels is None


def test_images_are_compared_as_divided_by_the_sheet() -> None:
    lighting = near(RING, 2.0)
    images = lit_by(lighting, *slopes(10, 0.3))
    plain = photometric_stereo(images, RING)
    assert plain.solved_images is plain.images
    flat_field = sheet_of(lighting, SHAPE)
    surface = photometric_stereo(images, RING, flat_field=flat_field)
    strengths = flat_field.without_cosines(RING).strengths(*map(np.arange, SHAPE), SHAPE)
    np.testing.assert_allclose(images_of(surface), images / strengths, rtol=1e-5)


def test_the_flat_field_of_other_lights_is_an_error() -> None:
    flat_field = FlatField(np.zeros((3, 1, 1)), np.zeros((3, 2)))
    images = np.ones((4, 2, 2), np.float32)
    with pytest.raises(InputError, match=r"flat field .* 3 lights"):
        photometric_stereo(images, Lighting.ring(45.0), flat_field=flat_field)


def test_a_flat_field_of_nan_or_swapped_bounds_is_refused() -> None:
    even, bounds = np.zeros((4, 2, 2)), np.tile([-1.0, 1.0], (4, 1))
    with pytest.raises(InputError, match="NaN or infinite"):
        FlatField(np.full_like(even, np.nan), bounds)
    with pytest.raises(InputError, match="in the wrong order"):
        FlatField(even, bounds[:, ::-1])
