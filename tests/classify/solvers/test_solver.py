"""`photometric_stereo` against rendered truth, closed forms and plain numpy."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from classify import METHODS, InputError, Lighting, photometric_stereo
from classify.lights.algebra import drop_one_constants

SEEDS = st.integers(0, 2**32 - 1)
FOR_FOUR = [method for method in METHODS if method != "rushmeier"]
PS3_TILTS = {"ps3a": (0, 90, 180), "ps3b": (90, 180, 270), "ps3c": (180, 270, 0),
             "ps3d": (270, 0, 90)}  # fmt: skip


def random_slopes(
    seed: int, shape: tuple[int, int], steepest: float = 0.4
) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    slope = steepest * np.sqrt(rng.random(shape))
    direction = 2 * np.pi * rng.random(shape)
    return slope * np.cos(direction), slope * np.sin(direction)


def render(
    p: np.ndarray, q: np.ndarray, albedo: np.ndarray | float, lighting: Lighting
) -> np.ndarray:
    """Lambertian float64 images, negative where the surface faces away."""
    normals = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1 + p * p + q * q)
    shading = np.tensordot(lighting.directions, normals, 1)
    return albedo * shading * lighting.intensities[:, None, None]


def least_volume(directions: np.ndarray) -> float:
    """How far any three of the lights are from lying in one plane."""
    return min(abs(float(a @ np.cross(b, c))) for a, b, c in combinations(directions, 3))


def tile(values: list[float], dtype: type = np.float32, side: int = 4) -> np.ndarray:
    return np.tile(np.array(values, dtype)[:, None, None], (1, side, side))


@st.composite
def rings(draw: st.DrawFn) -> Lighting:
    """Four lights near the tilts of the ring, at slants and intensities of their own."""
    tilts = [90.0 * k + draw(st.floats(-20, 20)) for k in range(4)]
    slants = [draw(st.floats(20, 50)) for _ in range(4)]
    intensities = [draw(st.floats(0.5, 2.0)) for _ in range(4)]
    directions = Lighting.from_angles(tilts, slants).directions
    assume(least_volume(directions) > 0.05)
    return Lighting(directions, np.array(intensities))


@st.composite
def general_lights(draw: st.DrawFn, fewest: int = 4, most: int = 4) -> Lighting:
    """Lights anywhere up to slant 55, but no three of four nearly in one plane."""
    count = draw(st.integers(fewest, most))
    sector = 360.0 / count
    first = draw(st.floats(0, 360))
    tilts = [first + sector * (k + draw(st.floats(-0.3, 0.3))) for k in range(count)]
    slants = [draw(st.floats(20, 55)) for _ in range(count)]
    intensities = [draw(st.floats(0.3, 3.0)) for _ in range(count)]
    order = draw(st.permutations(range(count)))
    directions = Lighting.from_angles(tilts, slants).directions[order]
    assume(count > 4 or least_volume(directions) > 0.03)
    return Lighting(directions, np.array(intensities))


@settings(max_examples=40, deadline=None)
@given(rings(), SEEDS, st.sampled_from(FOR_FOUR))
def test_every_method_recovers_a_surface_under_a_ring(
    lighting: Lighting, seed: int, method: str
) -> None:
    p, q = random_slopes(seed, (7, 9))
    albedo = np.random.default_rng(seed).uniform(50, 200, p.shape)
    images = render(p, q, albedo, lighting).astype(np.float32)
    surface = photometric_stereo(images, lighting, method)
    np.testing.assert_allclose(surface.p, p, atol=2e-4)
    np.testing.assert_allclose(surface.q, q, atol=2e-4)
    np.testing.assert_allclose(surface.albedo, albedo, rtol=2e-4)
    np.testing.assert_allclose(surface.residual, 0.0, atol=0.01)
    assert surface.valid.all()
    assert not surface.saturated.any()
    assert surface.method == method
    truth = np.stack([-p, -q, np.ones_like(p)], axis=-1) / np.sqrt(1 + p * p + q * q)[..., None]
    np.testing.assert_allclose(surface.normals, truth, atol=2e-4)


@settings(max_examples=40, deadline=None)
@given(general_lights(), SEEDS, st.sampled_from(["ps4", "least_squares", "drbohlav", "ps4_robust"]))
def test_four_lights_in_general_position_recover_a_surface(
    lighting: Lighting, seed: int, method: str
) -> None:
    p, q = random_slopes(seed, (6, 5))
    images = render(p, q, 100.0, lighting).astype(np.float32)
    surface = photometric_stereo(images, lighting, method)
    np.testing.assert_allclose(surface.p, p, atol=2e-3)
    np.testing.assert_allclose(surface.q, q, atol=2e-3)
    np.testing.assert_allclose(surface.albedo, 100.0, rtol=2e-3)


@settings(max_examples=40, deadline=None)
@given(general_lights(fewest=3, most=12), SEEDS)
def test_least_squares_is_that_of_numpy_for_any_number_of_lights(
    lighting: Lighting, seed: int
) -> None:
    p, q = random_slopes(seed, (5, 6))
    images = render(p, q, 100.0, lighting)
    images += np.random.default_rng(seed).normal(0, 2.0, images.shape) * (len(lighting) > 3)
    relative = images / lighting.intensities[:, None, None]
    b = np.linalg.lstsq(lighting.directions, relative.reshape(len(lighting), -1))[0]
    left_over = lighting.directions @ b - relative.reshape(len(lighting), -1)
    b = b.reshape(3, *p.shape)
    surface = photometric_stereo(images.astype(np.float32), lighting, "least_squares")
    ok = surface.valid
    np.testing.assert_allclose(surface.p[ok], -b[0][ok] / b[2][ok], atol=5e-3)
    np.testing.assert_allclose(surface.q[ok], -b[1][ok] / b[2][ok], atol=5e-3)
    np.testing.assert_allclose(surface.albedo, np.linalg.norm(b, axis=0), rtol=1e-3)
    rms = np.sqrt((left_over**2).mean(axis=0)).reshape(p.shape)
    np.testing.assert_allclose(surface.residual, rms, atol=5e-3)
    assert (surface.dropped == 255).all()


@pytest.mark.parametrize("method", ["ps4", "least_squares"])
@pytest.mark.parametrize(
    ("dtype", "white", "worst"), [(np.uint8, 250, 0.02), (np.uint16, 64000, 8e-5)]
)
def test_integer_images_differ_by_their_rounding_only(
    method: str, dtype: type, white: float, worst: float
) -> None:
    p, q = random_slopes(3, (40, 50))
    images = np.round(render(p, q, white, Lighting.ring())).astype(dtype)
    full_scale = np.iinfo(dtype).max
    surface = photometric_stereo(images, Lighting.ring(), method, full_scale=full_scale)
    assert np.abs(surface.p - p).max() < worst
    assert np.abs(surface.q - q).max() < worst
    np.testing.assert_allclose(surface.albedo, white / full_scale, rtol=worst)
    assert surface.valid.all()
    assert surface.p.dtype == surface.albedo.dtype == surface.residual.dtype == np.float32
    assert surface.dropped.dtype == surface.shadow_count.dtype == np.uint8


@pytest.mark.parametrize("method", ["ps4", "least_squares"])
def test_the_ambient_image_is_subtracted_from_every_image(method: str) -> None:
    """Also at a shadowed pixel that is darker, which must not wrap around."""
    rng = np.random.default_rng(0)
    p, q = random_slopes(0, (20, 20))
    images = np.round(render(p, q, 20000.0, Lighting.ring()))
    images[2, 5, 5] = -3.0
    ambient = rng.integers(500, 5000, p.shape).astype(np.uint16)
    lit = (images + ambient).astype(np.uint16)
    with_ambient = photometric_stereo(lit, Lighting.ring(), method, ambient=ambient)
    without = photometric_stereo(images.astype(np.float32), Lighting.ring(), method)
    np.testing.assert_allclose(with_ambient.p, without.p, atol=1e-6)
    np.testing.assert_allclose(with_ambient.q, without.q, atol=1e-6)
    np.testing.assert_allclose(with_ambient.albedo, without.albedo, rtol=1e-6)
    np.testing.assert_array_equal(with_ambient.shadow_count, without.shadow_count)
    assert with_ambient.shadow_count[5, 5] == 1


@pytest.mark.parametrize("slant_deg", [20.0, 45.0, 70.0])
def test_ps3_equals_its_closed_form(slant_deg: float) -> None:
    """For any three values; with the fourth, the noise found is zero."""
    a, b, c = np.random.default_rng(1).uniform(20, 100, (3, 30, 40))
    images = np.stack([a, b, c, a + c - b]).astype(np.float32)
    surface = photometric_stereo(images, Lighting.ring(slant_deg), "ps3a")
    slant = np.radians(slant_deg)
    p = -(a - c) / (a + c) / np.tan(slant)
    q = -(2 * b - a - c) / (a + c) / np.tan(slant)
    w = np.sqrt(1 + p * p + q * q)
    np.testing.assert_allclose(surface.p, p, atol=1e-4)
    np.testing.assert_allclose(surface.q, q, atol=1e-4)
    np.testing.assert_allclose(surface.albedo, (a + c) * w / (2 * np.cos(slant)), rtol=1e-5)


@pytest.mark.parametrize(("method", "tilts"), PS3_TILTS.items())
def test_ps3_does_not_depend_on_its_fourth_light(method: str, tilts: tuple[int, int, int]) -> None:
    p, q = random_slopes(5, (24, 24))
    images = render(p, q, 100.0, Lighting.ring()).astype(np.float32)
    unused = ({0, 90, 180, 270} - set(tilts)).pop() // 90
    images[unused, :8] = 0.0
    surface = photometric_stereo(images, Lighting.ring(), method)
    np.testing.assert_allclose(surface.p, p, atol=1e-4)
    np.testing.assert_allclose(surface.q, q, atol=1e-4)
    assert (surface.dropped == unused).all()
    assert (surface.shadow_count == (np.arange(24) < 8)[:, None]).all()


def numpy_ps4(values: np.ndarray, lighting: Lighting) -> np.ndarray:
    """(H, W, 3) scaled normals: mean of the solutions without each darkest light."""
    solved = np.zeros((*values.shape[1:], 3))
    for r, c in np.ndindex(*values.shape[1:]):
        pixel = values[:, r, c]
        solutions = [
            np.linalg.solve(np.delete(lighting.directions, k, 0), np.delete(pixel, k))
            for k in range(4)
            if pixel[k] == pixel.min()
        ]
        solved[r, c] = np.mean(solutions, axis=0)
    return solved


@settings(max_examples=25, deadline=None)
@given(rings() | general_lights(), SEEDS, st.booleans())
def test_ps4_equals_a_plain_drop_of_the_darkest_light(
    lighting: Lighting, seed: int, equal_intensities: bool
) -> None:
    if equal_intensities:
        lighting = Lighting(lighting.directions)
    rng = np.random.default_rng(seed)
    few = rng.choice([0, 0, 40, 90, 200], (4, 6, 16)).astype(np.uint8)
    any_value = rng.integers(0, 256, (4, 6, 16)).astype(np.uint8)
    images = np.concatenate([few, any_value], axis=1)
    # What is equal in float32 is a tie.
    gains = (1.0 / lighting.intensities).astype(np.float32)
    values = images * gains[:, None, None]
    b = numpy_ps4(values, lighting)
    rho = np.linalg.norm(b, axis=-1)
    # Black around them, so that the noise is that of rounding and most slopes count as known.
    frame = np.zeros((4, 48, 48), np.uint8)
    frame[:, :12, :16] = images
    surface = photometric_stereo(frame, lighting, "ps4")
    part = np.s_[:12, :16]
    np.testing.assert_allclose(surface.albedo[part], rho, rtol=1e-3, atol=0.02)
    np.testing.assert_array_equal(surface.dropped[part], values.argmin(axis=0))
    known = surface.valid[part]
    for found, axis in ((surface.p, 0), (surface.q, 1)):
        expected = -b[known][:, axis] / b[known][:, 2]
        assert (np.abs(found[part][known] - expected) < 1e-2 * (1 + expected**2)).all()
    # The second darkest, and how far the solutions without one or another of the darkest differ.
    second = np.sort(values, axis=0)[1]
    ties = (values == values.min(axis=0)).sum(axis=0)
    null = drop_one_constants(lighting, "ps4")[1]
    residual = np.abs(np.tensordot(null, values, 1))
    second = second - residual * (ties - 1) / ties / np.abs(null).min()
    assert known[(b[..., 2] > 0.3 * rho) & (rho > 150) & (second > 0.051 * rho)].all()
    assert not known[second < 0.049 * rho].any()
    assert not known[surface.shadow_count[part] > 1].any()
    assert not known[b[..., 2] <= 0.0].any()
    assert (surface.p[part][b[..., 2] <= 0.0] == 0).all()


@pytest.mark.parametrize("method", ["ps4", "drbohlav", "ps4_robust"])
@pytest.mark.parametrize("light", range(4))
def test_a_cast_shadow_is_counted_and_does_not_change_the_slopes(light: int, method: str) -> None:
    p, q = random_slopes(7, (20, 20))
    images = render(p, q, 100.0, Lighting.ring()).astype(np.float32)
    images[light, 10:] = 1.0
    surface = photometric_stereo(images, Lighting.ring(), method)
    np.testing.assert_allclose(surface.p, p, atol=1e-4)
    np.testing.assert_allclose(surface.q, q, atol=1e-4)
    assert (surface.shadow_count == (np.arange(20) >= 10)[:, None]).all()
    np.testing.assert_array_equal(surface.shadow_mask, surface.shadow_count > 0)
    assert (surface.residual[10:] > 1.0).all()


@pytest.mark.parametrize("method", ["ps4", "drbohlav", "ps4_robust"])
def test_an_attached_shadow_is_counted_and_does_not_change_the_slopes(method: str) -> None:
    """A slope of 0.8 towards light 180 at slant 60 faces away from light 0.

    Its value is 0 instead of negative: the residual has the other sign than for a cast shadow.
    """
    p = np.zeros((32, 32))
    p[:8] = 0.8
    q = np.zeros_like(p)
    images = np.maximum(render(p, q, 100.0, Lighting.ring(60.0)), 0.0).astype(np.float32)
    assert (images == 0).sum() == 8 * 32
    surface = photometric_stereo(images, Lighting.ring(60.0), method)
    np.testing.assert_allclose(surface.p, p, atol=1e-4)
    np.testing.assert_allclose(surface.q, 0.0, atol=1e-4)
    assert (surface.shadow_count == (p > 0)).all()
    assert (surface.dropped[:8] == 0).all()
    assert surface.valid.all()


def test_a_black_pixel_is_in_shadow_only_where_its_slope_is_filled_in() -> None:
    """A hole in shadow or a black backdrop: without a prediction nobody knows."""
    images = tile([100, 100, 100, 100], np.uint8)
    images[:, 0, 0] = 0
    for method in FOR_FOUR:
        surface = photometric_stereo(images, Lighting.ring(), method)
        assert surface.shadow_count[0, 0] == 4 * (method == "ps4_robust")
        assert (surface.shadow_count.ravel()[1:] == 0).all()
        assert not surface.valid[0, 0]
        assert abs(surface.p[0, 0]) + abs(surface.q[0, 0]) < 1e-6
        # Only ps4_robust fills in the albedo of a pixel without light.
        assert abs(surface.albedo[0, 0] - 141.4 * (method == "ps4_robust")) < 0.1


@pytest.mark.parametrize("method", FOR_FOUR)
def test_a_saturated_light_is_left_out_where_three_others_are_left(method: str) -> None:
    """PS4 and PS3 have no light to spare: there the pixel is invalid."""
    p, q = random_slopes(11, (12, 12))
    images = np.round(render(p, q, 40_000.0, Lighting.ring()))
    for light in range(4):
        images[light, 3 * light : 3 * light + 3, :6] = 65_535
    images = images.astype(np.uint16)
    surface = photometric_stereo(images, Lighting.ring(), method, full_scale=65_535)
    known = np.ones(p.shape, bool)
    if method == "ps4":
        known[:, :6] = False
    if method.startswith("ps3"):
        used = [light for light in range(4) if light != int(surface.dropped[0, 0])]
        for light in used:
            known[3 * light : 3 * light + 3, :6] = False
    np.testing.assert_array_equal(surface.valid, known)
    np.testing.assert_allclose(surface.p[known], p[known], atol=1e-3)
    np.testing.assert_allclose(surface.q[known], q[known], atol=1e-3)


def test_saturation_is_judged_before_ambient_light_is_subtracted() -> None:
    images, ambient = tile([255, 200, 200, 200], np.uint8), np.full((4, 4), 30, np.uint8)
    surface = photometric_stereo(images, Lighting.ring(), ambient=ambient, full_scale=255)
    assert surface.saturated.all()
    assert not photometric_stereo(images, Lighting.ring(), ambient=ambient).saturated.any()


def test_a_solution_that_faces_away_is_not_valid() -> None:
    """20 times brighter under the lower of two lights on one side."""
    lighting = Lighting.from_angles([0, 0, 90], [10, 50, 30])
    facing = photometric_stereo(tile([90, 80, 85]), lighting, "least_squares")
    away = photometric_stereo(tile([10, 200, 100]), lighting, "least_squares")
    assert facing.valid.all()
    assert not away.valid.any()
    assert (away.p == 0).all()
    assert (away.q == 0).all()


@pytest.mark.parametrize("method", ["least_squares", "ps4"])
def test_slopes_that_drown_in_noise_are_not_valid(method: str) -> None:
    """On a darkening surface, validity ends where the slope error reaches 0.5."""
    sigma = 2.0
    lighting = Lighting.ring()
    albedo = np.geomspace(200.0, 0.2, 400)[None, :] * np.ones((400, 1))
    zeros = np.zeros_like(albedo)
    clean = render(zeros, zeros, albedo, lighting)
    noise = np.random.default_rng(0).normal(0, sigma, clean.shape)
    surface = photometric_stereo((clean + noise).astype(np.float32), lighting, method)
    # b_x = (i0 - i180) / (2 sin s): its standard error is sigma at slant 45.
    edge = sigma / 0.5
    valid_share = surface.valid.mean(axis=0)
    assert (valid_share[albedo[0] > 2.0 * edge] > 0.98).all()
    assert (valid_share[albedo[0] < 0.2 * edge] < 0.25).all()
    column = int(np.argmin(np.abs(albedo[0] - 2.0 * edge)))
    near = surface.p[:, column - 10 : column + 10]
    assert near.std() == pytest.approx(0.25, rel=0.2)
    assert (surface.p[~surface.valid & (surface.shadow_count < 2)] == 0).all()
    wildest = np.percentile(np.hypot(surface.p, surface.q)[surface.valid], 99.9)
    assert wildest < 3.0


def test_lists_and_strided_views_give_the_result_of_a_stack() -> None:
    images = np.random.default_rng(0).integers(50, 200, (8, 24, 20)).astype(np.float32)
    view = images[::2, ::3, ::-2]
    expected = photometric_stereo(view.copy(), Lighting.ring())
    for given_as in (view, list(view), tuple(view)):
        surface = photometric_stereo(given_as, Lighting.ring())
        np.testing.assert_array_equal(surface.p, expected.p)
        assert surface.shape == (8, 10)


FRAME = np.full((8, 8), 100, np.uint8)
RING = Lighting.ring()


@pytest.mark.parametrize(
    ("images", "lighting", "method", "cause"),
    [
        ([FRAME] * 3, RING, "ps4", "3 images for 4 lights"),
        ([FRAME] * 3, Lighting.ring(45, [0, 120, 240]), "ps4", "needs exactly 4 lights"),
        ([FRAME] * 3, Lighting.ring(45, [0, 90, 180]), "ps3a", "chooses 3 of 4 lights"),
        ([], RING, "ps4", "no images"),
        ([FRAME] * 3 + [FRAME[:4]], RING, "ps4", r"\(4 x 8, 8 x 8\)"),
        ([FRAME] * 3 + [FRAME.astype(np.uint16)], RING, "ps4", "differ in type"),
        (FRAME, RING, "ps4", "have shape"),
        (np.zeros((4, 0, 5), np.uint8), RING, "ps4", "have shape"),
        (np.ones((4, 5, 5)), RING, "ps4", "float64"),
        ([FRAME] * 4, RING, "ps5", "unknown method 'ps5'"),
        ([FRAME] * 4, Lighting.ring(45, [45, 135, 225, 315]), "ps3a", "no light stands near"),
        ([FRAME] * 4, Lighting.ring(0.0), "ps4", "light 0 .* one plane"),
        ([FRAME] * 4, Lighting.from_angles([0, 0, 0, 90], [10, 30, 50, 40]), "ps4",
         "light 3 .* one plane"),
        ([FRAME] * 4, Lighting.from_angles([0, 0, 180, 0], [10, 30, 50, 40]), "least_squares",
         "in one plane"),
        ([FRAME] * 2, Lighting.ring(45, [0, 90]), "least_squares", "at least three"),
    ],
)  # fmt: skip
def test_unusable_input_is_named(
    images: object, lighting: Lighting, method: str, cause: str
) -> None:
    with pytest.raises(InputError, match=cause):
        photometric_stereo(images, lighting, method)


@pytest.mark.parametrize(
    ("bad", "cause"),
    [(np.nan, "NaN or infinity"), (-np.inf, "NaN or infinity"), (1e25, "a value beyond 1e"),
     (-3e38, "a value beyond 1e")],
)  # fmt: skip
def test_a_pixel_value_that_cannot_be_used_is_named(bad: float, cause: str) -> None:
    images = tile([100, 100, 100, 100])
    with pytest.raises(InputError, match=f"ambient image contains {cause}"):
        photometric_stereo(images, RING, ambient=np.full((4, 4), bad, np.float32))
    images[2, 1, 1] = bad
    with pytest.raises(InputError, match=f"image 2 contains {cause}"):
        photometric_stereo(images, RING)


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        ({"ambient": FRAME[:4]}, r"ambient image .*agree"),
        ({"ambient": FRAME.astype(np.uint16)}, r"ambient image .*agree"),
        *(({"full_scale": bad}, "positive pixel value") for bad in (0, -1, np.nan, np.inf)),
        *(({"full_scale": bad}, "full_scale times the intensity") for bad in (1e-300, 1e300)),
    ],
)
def test_unusable_options_are_named(options: dict, cause: str) -> None:
    with pytest.raises(InputError, match=cause):
        photometric_stereo([FRAME] * 4, RING, **options)


def test_more_lights_than_the_maps_can_count_are_refused() -> None:
    lighting = Lighting.ring(45, tilts_deg=np.linspace(0, 350, 256))
    with pytest.raises(InputError, match="at most 255"):
        photometric_stereo(np.ones((256, 2, 2), np.uint8), lighting, "least_squares")
