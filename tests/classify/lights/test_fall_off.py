"""Fall-off of near lights over planar parts: found and told from relief."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import Lighting, SensorNoise, SurfaceEstimate, photometric_stereo
from classify.base.errors import InputError
from classify.lights.flat_field import exponential

SIDE = 96
RING = Lighting.ring(45.0)
Field = np.ndarray


def coordinates(rows: int = SIDE, columns: int = SIDE) -> tuple[Field, Field]:
    """X to the right and y up, in half of the longer side from the middle."""
    unit = 0.5 * max(rows, columns)
    x = (np.arange(columns) - 0.5 * (columns - 1)) / unit
    y = (0.5 * (rows - 1) - np.arange(rows)) / unit
    return np.meshgrid(x, y)


def fine_relief(rows: int = SIDE, columns: int = SIDE) -> tuple[Field, Field]:
    """Slopes of rms 0.3 of waves of a few pixels."""
    rng = np.random.default_rng(3)
    r, c = np.mgrid[:rows, :columns]
    p, q = np.zeros((2, rows, columns))
    for _ in range(40):
        angle, period_px, phase = rng.uniform(0.0, 2 * np.pi, 3) * (1, 1.5, 1) + (0, 4, 0)
        wave = np.cos(2 * np.pi * (np.cos(angle) * c - np.sin(angle) * r) / period_px + phase)
        p += np.cos(angle) * wave
        q += np.sin(angle) * wave
    scale = 0.3 / np.sqrt((p * p + q * q).mean())
    return scale * p, scale * q


def near_light_images(
    p: Field, q: Field, strengths: Field, lighting: Lighting = RING, brightest: float = 3000.0
) -> Field:
    """12-bit images of random albedo; `strengths` (N, H, W) of the lights."""
    rng = np.random.default_rng(0)
    albedo = rng.uniform(0.4, 1.0, p.shape)
    x, y, z = lighting.directions.T[..., None, None]
    shading = np.maximum((z - x * p - y * q) / np.sqrt(1.0 + p * p + q * q), 0.0)
    values = brightest * albedo * strengths * shading + rng.normal(0.0, 2.0, strengths.shape)
    return np.clip(np.rint(values + 40.0), 0, 4095).astype(np.uint16)


AMBIENT = np.full((SIDE, SIDE), 40, np.uint16)


def solved(
    images: Field, planar: bool = True, lighting: Lighting = RING, **more: object
) -> SurfaceEstimate:
    settings = {"ambient": np.full(images.shape[1:], 40, np.uint16), "full_scale": 4095.0} | more
    return photometric_stereo(images, lighting, planar=planar, **settings)


def slope_error(surface: SurfaceEstimate, p: Field, q: Field) -> float:
    return float(np.sqrt(np.mean((surface.p - p) ** 2 + (surface.q - q) ** 2)))


def towards(lighting: Lighting, linear: float, quadratic: float, shape: tuple[int, int]) -> Field:
    """Strengths that rise towards each light."""
    x, y = coordinates(*shape)
    tilts = np.radians(lighting.tilts_deg)[:, None, None]
    along = np.cos(tilts) * x + np.sin(tilts) * y
    return np.exp(linear * along + quadratic * along**2)


@settings(deadline=None, max_examples=12)
@given(
    linear=st.floats(-0.4, 0.4),
    quadratic=st.floats(-0.2, 0.2),
    levels=st.tuples(*[st.floats(0.7, 1.3)] * 4),
    slants_deg=st.tuples(*[st.floats(30.0, 60.0)] * 4),
    shape=st.sampled_from([(96, 96), (64, 128), (130, 70)]),
)
def test_fall_off_and_levels_do_not_change_the_slopes(
    linear: float, quadratic: float, levels: tuple[float, ...], slants_deg: tuple[float, ...],
    shape: tuple[int, int],
) -> None:  # fmt: skip
    lighting = Lighting.from_angles((0.0, 90.0, 180.0, 270.0), slants_deg)
    p, q = fine_relief(*shape)
    strengths = towards(lighting, linear, quadratic, shape) * np.array(levels)[:, None, None]
    images = near_light_images(p, q, strengths, lighting, brightest=1200.0)
    even = near_light_images(p, q, np.ones_like(strengths), lighting, brightest=1200.0)
    found = solved(images, lighting=lighting, method="least_squares")
    least = slope_error(solved(even, False, lighting, method="least_squares"), p, q)
    assert slope_error(found, p, q) < least + 0.02
    assert found.fall_off is not None


def test_near_lights_ruin_slopes_unless_the_part_is_solved_as_planar() -> None:
    p, q = fine_relief()
    images = near_light_images(p, q, towards(RING, 0.4, -0.1, p.shape))
    assert slope_error(solved(images, planar=False), p, q) > 0.15
    assert slope_error(solved(images), p, q) < 0.02


def test_the_share_of_the_fall_off_is_reported() -> None:
    p, q = fine_relief()
    strengths = towards(RING, 0.15, 0.0, p.shape)
    found = solved(near_light_images(p, q, strengths)).fall_off
    assert found is not None
    # exp(-0.3) between the ends of the middle line.
    assert found.largest_fall_off == pytest.approx(1.0 - np.exp(-0.3), abs=0.02)


@settings(deadline=None, max_examples=8)
@given(st.integers(0, 3), st.booleans(), st.sampled_from([(96, 96), (70, 112)]))
def test_no_direction_is_preferred(turns: int, mirrored: bool, shape: tuple[int, int]) -> None:
    p, q = fine_relief(*shape)
    x, y = coordinates(*shape)
    strengths = np.exp([0.3 * x + 0.1 * x * y, 0.2 * y, -0.4 * x + 0.2 * y * y, -0.1 * y])
    images = near_light_images(p, q, strengths)
    first = solved(images)

    def moved(array: Field) -> Field:
        rotated = np.rot90(array, turns, axes=(-2, -1))
        return rotated[..., ::-1] if mirrored else rotated

    directions = RING.directions.copy()
    expected = np.stack([first.p, first.q])
    for _ in range(turns):
        directions[:, :2] = np.stack([-directions[:, 1], directions[:, 0]], axis=1)
        expected = np.stack([-expected[1], expected[0]])
    if mirrored:
        directions[:, 0] *= -1.0
        expected[0] *= -1.0
    again = solved(np.ascontiguousarray(moved(images)), lighting=Lighting(directions))
    np.testing.assert_allclose(np.stack([again.p, again.q]), moved(expected), atol=2e-4)


def wave(cycles: float) -> tuple[Field, Field]:
    x, _ = coordinates()
    return 0.4 * np.sin(np.pi * cycles * x), np.zeros_like(x)


def groove() -> tuple[Field, Field]:
    x, _ = coordinates()
    return np.where(abs(x - 0.3) < 0.15, 0.6 * np.sign(x - 0.3), 0.0), np.zeros_like(x)


def bricks() -> tuple[Field, Field]:
    """Bricks of half the frame, with steep edges."""
    x, y = coordinates()
    near = [
        np.exp(-((((each + 0.3) % 1.0) / 0.1) ** 2))
        - np.exp(-(((1 - (each + 0.3) % 1.0) / 0.1) ** 2))
        for each in (x, y)
    ]
    return 0.8 * near[0], 0.8 * near[1]


@pytest.mark.parametrize(
    ("relief", "least_gain"),
    [(groove, 0.99), (bricks, 0.99), (lambda: wave(8), 0.98), (lambda: wave(3), 0.92)],
    ids=["groove", "bricks", "8 waves", "3 waves"],
)
def test_coarse_relief_is_not_taken_for_fall_off(
    relief: Callable[[], tuple[Field, Field]], least_gain: float
) -> None:
    p, q = relief()
    images = near_light_images(p, q, np.ones((4, SIDE, SIDE)))
    found, distant = solved(images), solved(images, planar=False)
    gain = (found.p * distant.p).sum() / (distant.p * distant.p).sum()
    assert gain > least_gain


def degree(surface: SurfaceEstimate) -> int:
    assert surface.fall_off is not None
    i, j = np.nonzero(np.abs(surface.fall_off.coefficients).max(axis=0))
    return int((i + j).max())


def test_degree_4_is_taken_for_steep_fall_off_only() -> None:
    p, q = fine_relief()
    x, y = coordinates()
    tilts = np.radians(RING.tilts_deg)[:, None, None]
    # A light beside the frame: 1 / r^2, from 0.5 to 2.5 half frames away.
    beside = 1.0 / ((x - 1.5 * np.cos(tilts)) ** 2 + (y - 1.5 * np.sin(tilts)) ** 2 + 0.3)
    images = near_light_images(p, q, beside, brightest=1000.0)
    steep = solved(images, method="least_squares")
    assert degree(steep) == 4
    assert slope_error(steep, p, q) < 0.03
    assert degree(solved(near_light_images(p, q, towards(RING, 0.2, 0.1, p.shape)))) == 2
    # A wave of the length of the frame is a polynomial of degree 4 as well, but relief.
    assert degree(solved(near_light_images(*wave(1), np.ones((4, SIDE, SIDE))))) == 2


def test_saturation_is_that_of_the_camera() -> None:
    p, q = fine_relief()
    images = near_light_images(p, q, towards(RING, 0.3, 0.0, p.shape), brightest=5500.0)
    surface = solved(images)
    assert 0.01 < surface.saturated.mean() < 0.5
    np.testing.assert_array_equal(surface.saturated, images.max(axis=0) == 4095)
    least_squares = solved(images, method="least_squares")
    assert not least_squares.valid[(images == 4095).sum(axis=0) >= 2].any()


def test_residual_and_shadow_are_those_of_the_divided_images() -> None:
    p, q = fine_relief()
    images = near_light_images(p, q, towards(RING, 0.4, -0.15, p.shape))
    planar, distant = solved(images), solved(images, planar=False)
    assert np.median(planar.residual) < 0.2 * np.median(distant.residual)
    assert planar.shadow_mask.mean() < 0.05


@pytest.mark.parametrize("masked", [False, True])
def test_only_the_part_counts(masked: bool) -> None:
    p, q = fine_relief()
    x, _ = coordinates()
    part = x < 0.2
    images = near_light_images(p, q, towards(RING, 0.3, 0.0, p.shape))
    rng = np.random.default_rng(5)
    # Black, or another object in other light beside it.
    noise = rng.normal(45.0, 3.0, images.shape)
    other = images * np.array([2.0, 1.0, 0.5, 0.3])[:, None, None]
    images = np.where(part, images, other if masked else noise).clip(0, 4095).astype(np.uint16)
    surface = solved(images, mask=part if masked else None)
    inside = part & (x < 0.15)
    assert np.sqrt(np.mean((surface.p - p)[inside] ** 2)) < 0.02
    if masked:
        assert not surface.valid[~part].any()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("cycles", "rows", "columns"), [(3, (2, 14), (3, 63)), (2, (40, 70), (30, 70))]
)
def test_a_small_part_of_coarse_relief_is_solved(
    cycles: int, rows: tuple[int, int], columns: tuple[int, int]
) -> None:
    """Far from it the fitted polynomial is beyond what exp can represent."""
    x, y = coordinates()
    p, q = 0.4 * np.sin(2 * np.pi * cycles * x), 0.4 * np.cos(2 * np.pi * cycles * y)
    images = near_light_images(p, q, towards(RING, 0.5, 0.0, p.shape))
    part = np.zeros(p.shape, np.bool_)
    part[slice(*rows), slice(*columns)] = True
    surface = solved(images, mask=part)
    assert np.isfinite(surface.p).all()
    assert surface.valid[part].mean() > 0.9


@pytest.mark.parametrize("level", [0, 4095])
def test_nothing_is_divided_where_too_little_is_lit(level: int) -> None:
    p, q = fine_relief()
    images = near_light_images(p, q, towards(RING, 0.3, 0.0, p.shape))
    images[:, :, : 19 * SIDE // 20] = level
    planar, distant = solved(images), solved(images, planar=False)
    assert planar.planar
    assert planar.fall_off is None
    assert not distant.planar
    np.testing.assert_array_equal(planar.p, distant.p)


def test_gloss_does_not_move_the_fit() -> None:
    p, q = fine_relief()
    images = near_light_images(p, q, towards(RING, 0.3, 0.0, p.shape), brightest=1500.0)
    glints = np.random.default_rng(1).random(images[0].shape) < 0.05
    glossy = images.copy()
    glossy[1][glints] = 4000
    change = solved(glossy, method="least_squares").p - solved(images, method="least_squares").p
    assert np.abs(change[~glints]).max() < 0.01


def test_given_intensities_stay_in_the_result() -> None:
    p, q = fine_relief()
    images = near_light_images(
        p, q, np.ones((4, SIDE, SIDE)) * [[[1.0]], [[0.8]], [[1.2]], [[1.0]]]
    )
    given_levels = Lighting(RING.directions, np.array([1.0, 0.8, 1.2, 1.0]))
    for lighting in (RING, given_levels):
        surface = solved(images, lighting=lighting)
        assert surface.lighting == lighting
        assert surface.led_levels is None
        assert slope_error(surface, p, q) < 0.02


def test_more_lights_and_the_noise_of_a_sensor() -> None:
    lighting = Lighting.ring(50.0, [60.0 * light for light in range(6)])
    p, q = fine_relief()
    images = near_light_images(p, q, towards(lighting, 0.3, -0.1, p.shape), lighting)
    surface = solved(images, lighting=lighting, noise=SensorNoise(5.0, 2.0, 40.0))
    assert surface.method == "least_squares"
    assert surface.valid.mean() > 0.99
    assert slope_error(surface, p, q) < 0.02


@pytest.mark.parametrize(("largest", "error"), [(1.0, 2e-6), (2.0, 6e-6), (4.0, 2e-4)])
def test_the_exponential_of_the_kernels(largest: float, error: float) -> None:
    exponents = np.linspace(-largest, largest, 401, dtype=np.float32)
    found = [exponential(e) for e in exponents]
    np.testing.assert_allclose(found, np.exp(exponents), rtol=error)


def test_a_mask_of_another_shape_is_refused() -> None:
    with pytest.raises(InputError, match=r"the mask has shape \(5, 5\)"):
        solved(
            near_light_images(*fine_relief(), np.ones((4, SIDE, SIDE))), mask=np.ones((5, 5), bool)
        )
