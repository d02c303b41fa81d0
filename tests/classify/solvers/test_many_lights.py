"""Methods for four lights and more that leave some out: rushmeier and drbohlav."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import InputError, Lighting, Method, SensorNoise, photometric_stereo
from classify.solvers.drbohlav import residual_limits
from classify.solvers.robust import TOLERANCE

SEEDS = st.integers(0, 2**32 - 1)
# Where every pixel has its fault, the images do not tell how noisy they are.
QUIET = SensorNoise(gain_e_per_dn=1e9, read_noise_dn=0.1)


def ring_of(count: int, slant_deg: float = 40.0) -> Lighting:
    return Lighting.ring(slant_deg, tilts_deg=np.arange(count) * 360.0 / count)


def bumps(lighting: Lighting, side: int = 40, albedo: float = 1000.0) -> tuple[np.ndarray, ...]:
    """P, q and the float64 images of a gently waved surface, no shadow anywhere."""
    x, y = np.meshgrid(np.arange(side) / 5.0, np.arange(side) / 7.0)
    p, q = 0.25 * np.sin(x), 0.25 * np.cos(x + y)
    normals = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1 + p * p + q * q)
    shading = np.tensordot(lighting.directions, normals, 1)
    return p, q, albedo * shading * lighting.intensities[:, None, None]


def without(lighting: Lighting, values: np.ndarray, left_out: set[int]) -> np.ndarray:
    used = [k for k in range(len(lighting)) if k not in left_out]
    return np.linalg.lstsq(lighting.directions[used], values[used])[0]


@settings(max_examples=25, deadline=None)
@given(st.integers(5, 12), SEEDS)
def test_rushmeier_is_least_squares_without_the_lowest_and_the_highest(
    count: int, seed: int
) -> None:
    """For any values; lowest and highest are those after division by the intensities."""
    rng = np.random.default_rng(seed)
    tilts = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 360.0 / count
    directions = Lighting.from_angles(list(tilts), list(rng.uniform(25, 55, count))).directions
    lighting = Lighting(directions, rng.uniform(0.3, 3.0, count))
    images = rng.uniform(50, 250, (count, 4, 5)).astype(np.float32)
    surface = photometric_stereo(images, lighting, "rushmeier")
    values = images / lighting.intensities[:, None, None]
    for r, c in np.ndindex(4, 5):
        pixel = values[:, r, c]
        left_out = [int(pixel.argmin()), int(pixel.argmax())]
        if np.linalg.svd(np.delete(lighting.directions, left_out, 0))[1][-1] < 0.05:
            continue
        b = without(lighting, pixel, set(left_out))
        assert surface.albedo[r, c] == pytest.approx(np.linalg.norm(b), rel=2e-3)
        assert surface.dropped[r, c] == pixel.argmin()
        if surface.valid[r, c]:
            assert surface.p[r, c] == pytest.approx(
                -b[0] / b[2], abs=5e-3 * (1 + (b[0] / b[2]) ** 2)
            )
            assert surface.q[r, c] == pytest.approx(
                -b[1] / b[2], abs=5e-3 * (1 + (b[1] / b[2]) ** 2)
            )


@pytest.mark.parametrize("count", [5, 6, 9])
def test_rushmeier_ignores_one_shadow_and_one_highlight(count: int) -> None:
    lighting = ring_of(count)
    p, q, images = bumps(lighting)
    rng = np.random.default_rng(0)
    shadowed, shining = rng.permuted(np.tile(np.arange(count), (p.size, 1)), axis=1).T[:2]
    flat = images.reshape(count, -1)
    flat[shadowed, np.arange(p.size)] = 0.0
    flat[shining, np.arange(p.size)] *= 3.0
    surface = photometric_stereo(images.astype(np.float32), lighting, "rushmeier", noise=QUIET)
    np.testing.assert_allclose(surface.p, p, atol=1e-4)
    np.testing.assert_allclose(surface.q, q, atol=1e-4)
    assert surface.valid.all()
    assert surface.specular.all()
    assert (surface.shadow_count == 1).all()
    np.testing.assert_array_equal(surface.dropped.ravel(), shadowed)
    # Another method of the same lights does not bear it.
    plain = photometric_stereo(images.astype(np.float32), lighting, "least_squares")
    assert np.abs(plain.p - p).mean() > 0.1


def test_rushmeier_marks_pixels_whose_other_lights_are_in_one_plane() -> None:
    """A ring of four and a light above: without lights 0 and 180, p is undetermined."""
    lighting = Lighting.from_angles([0, 90, 180, 270, 0], [45, 45, 45, 45, 0])
    images = np.zeros((5, 1, 2), np.float32)
    images[:, 0, 0] = [20, 60, 100, 61, 80]
    images[:, 0, 1] = [20, 60, 90, 61, 100]
    surface = photometric_stereo(images, lighting, "rushmeier")
    np.testing.assert_array_equal(surface.valid, [[False, True]])


def test_lights_of_which_no_three_determine_a_normal_are_refused() -> None:
    three_and_two = Lighting.from_angles([0, 120, 240, 0, 0], [40, 40, 40, 40, 40])
    assert photometric_stereo(np.ones((5, 4, 4), np.float32), three_and_two, "rushmeier")
    flat = Lighting.from_angles([0, 180, 0, 180, 90], [20, 20, 60, 60, 40])
    assert photometric_stereo(np.ones((5, 4, 4), np.float32), flat, "least_squares")
    fan = Lighting.from_angles([0, 0, 0, 180, 180], [20, 40, 60, 30, 50])
    with pytest.raises(InputError, match="lie in one plane"):
        photometric_stereo(np.ones((5, 4, 4), np.float32), fan, "rushmeier")


@pytest.mark.parametrize("method", ["rushmeier", "drbohlav"])
def test_the_error_for_too_few_lights_names_another_method(method: str) -> None:
    few = {"rushmeier": 4, "drbohlav": 3}[method]
    with pytest.raises(InputError, match=rf"method {method} .* this set has {few}; use "):
        photometric_stereo(np.ones((few, 4, 4), np.float32), ring_of(few), method)


@pytest.mark.parametrize("method", ["least_squares", "rushmeier", "drbohlav"])
@pytest.mark.parametrize("saturated", [1, 2])
def test_saturated_lights_are_left_out_of_six(method: str, saturated: int) -> None:
    lighting = ring_of(6)
    p, q, images = bumps(lighting, albedo=3000.0)
    rng = np.random.default_rng(1)
    chosen = rng.permuted(np.tile(np.arange(6), (p.size, 1)), axis=1).T[:saturated]
    for lights in chosen:
        images.reshape(6, -1)[lights, np.arange(p.size)] = 4095.0
    images = np.round(images).astype(np.uint16)
    surface = photometric_stereo(images, lighting, method, full_scale=4095)
    assert surface.saturated.all()
    assert surface.valid.all()
    np.testing.assert_allclose(surface.p, p, atol=3e-3)
    np.testing.assert_allclose(surface.q, q, atol=3e-3)


@settings(max_examples=25, deadline=None)
@given(st.integers(3, 5), SEEDS)
def test_least_squares_leaves_out_saturated_lights_at_any_pixels(count: int, seed: int) -> None:
    """One kernel solves three or four images, another one more."""
    lighting = ring_of(count)
    rng = np.random.default_rng(seed)
    images = rng.uniform(80.0, 200.0, (count, 6, 7)).astype(np.float32)
    saturated = rng.random(images.shape) < 0.15
    images[saturated] = 255.0
    surface = photometric_stereo(images, lighting, "least_squares", full_scale=255.0)
    np.testing.assert_array_equal(surface.saturated, saturated.any(axis=0))
    for r, c in np.ndindex(6, 7):
        left_out = {*map(int, np.flatnonzero(saturated[:, r, c]))}
        if count - len(left_out) < 3:
            assert not surface.valid[r, c]
            assert (surface.p[r, c], surface.q[r, c]) == (0.0, 0.0)
            continue
        b = without(lighting, images[:, r, c], left_out)
        assert 255.0 * surface.albedo[r, c] == pytest.approx(np.linalg.norm(b), rel=1e-4)
        if surface.valid[r, c]:
            found = (surface.p[r, c], surface.q[r, c])
            assert found == pytest.approx((-b[0] / b[2], -b[1] / b[2]), rel=1e-3, abs=1e-3)


@pytest.mark.parametrize("method", ["least_squares", "rushmeier", "drbohlav"])
def test_a_pixel_saturated_under_most_lights_is_not_valid(method: str) -> None:
    lighting = ring_of(5)
    images = np.full((5, 4, 4), 4095, np.uint16)
    images[:, 1:] = 2000
    images[3:, 0] = 2000
    surface = photometric_stereo(images, lighting, method, full_scale=4095)
    np.testing.assert_array_equal(surface.valid, (np.arange(4) > 0)[:, None] * [[True] * 4])
    np.testing.assert_array_equal(surface.saturated, ~surface.valid)


@pytest.mark.parametrize("count", [5, 6, 8])
@pytest.mark.parametrize("fault", ["shadow", "highlight"])
def test_five_lights_and_more_show_which_one_is_wrong(count: int, fault: str) -> None:
    lighting = ring_of(count)
    p, q, images = bumps(lighting)
    wrong = np.random.default_rng(3).integers(0, count, p.size)
    flat = images.reshape(count, -1)
    flat[wrong, np.arange(p.size)] *= 0.0 if fault == "shadow" else 2.0
    surface = photometric_stereo(images.astype(np.float32), lighting, "drbohlav", noise=QUIET)
    np.testing.assert_allclose(surface.p, p, atol=1e-4)
    np.testing.assert_allclose(surface.q, q, atol=1e-4)
    np.testing.assert_array_equal(surface.dropped.ravel(), wrong)
    assert (surface.specular == (fault == "highlight")).all()
    assert (surface.shadow_count == (fault == "shadow")).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(6, 12), SEEDS)
def test_the_light_goes_whose_absence_leaves_the_smallest_residuals(count: int, seed: int) -> None:
    """Against one least squares solution without each light; no value is dark."""
    rng = np.random.default_rng(seed)
    tilts = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 360.0 / count
    lighting = Lighting.from_angles(list(tilts), list(rng.uniform(25, 55, count)))
    values = rng.uniform(120, 250, (count, 3))
    noise = SensorNoise(gain_e_per_dn=1e9, read_noise_dn=8.0)
    surface = photometric_stereo(
        values.astype(np.float32)[:, None], lighting, "drbohlav", noise=noise
    )
    for pixel, p, q in zip(values.T, surface.p[0], surface.q[0], strict=True):
        gone: set[int] = set()

        def squares(left_out: set[int], pixel: np.ndarray = pixel) -> float:
            used = [k for k in range(count) if k not in left_out]
            return float(np.linalg.lstsq(lighting.directions[used], pixel[used])[1][0])

        tolerance = (TOLERANCE * pixel.max()) ** 2
        while (
            count - len(gone) > 4
            and squares(gone) > residual_limits(count)[count - len(gone)] * 64 + tolerance
        ):
            gone.add(min(set(range(count)) - gone, key=lambda k: squares(gone | {k})))
        if 2 * (count - len(gone)) <= count:
            gone = set()  # no majority agrees: all lights are used
        elif count - len(gone) == 4:
            continue  # four lights are settled by another rule
        b = without(lighting, pixel, gone)
        assert (p, q) == pytest.approx((-b[0] / b[2], -b[1] / b[2]), abs=1e-3)


@pytest.mark.parametrize("method", ["least_squares", "rushmeier", "drbohlav"])
def test_progress_is_told_up_to_the_last_row(method: str) -> None:
    shares: list[float] = []
    images = np.full((24, 60, 2000), 90, np.uint16)
    photometric_stereo(images, ring_of(24), method, on_progress=shares.append)
    assert len(shares) > 3
    assert max(shares) == 1.0
    assert min(shares) > 0.0


def test_lights_of_which_no_majority_agrees_are_all_used() -> None:
    """Without most lights, as of unknown intensities, all pixels would be specular."""
    lighting = ring_of(24)
    _, _, images = bumps(lighting)
    images *= np.random.default_rng(1).lognormal(0.0, 0.2, 24)[:, None, None]
    surface = photometric_stereo(images.astype(np.float32), lighting, "drbohlav", noise=QUIET)
    plain = photometric_stereo(images.astype(np.float32), lighting, "least_squares", noise=QUIET)
    np.testing.assert_allclose(surface.p, plain.p, atol=1e-4)
    np.testing.assert_allclose(surface.albedo, plain.albedo, rtol=1e-4)
    assert (surface.dropped == 255).all()
    assert not surface.specular.any()


@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_a_light_left_out_is_named_where_no_majority_agrees(factor: float) -> None:
    """A dark light, and a saturated one."""
    lighting = ring_of(24)
    _, _, images = bumps(lighting)
    images *= np.random.default_rng(1).lognormal(0.0, 0.2, 24)[:, None, None]
    saturation = 1.1 * float(images.max())
    images[7] *= factor
    images[7] = np.where(factor > 0.0, saturation, images[7])
    surface = photometric_stereo(
        images.astype(np.float32), lighting, "drbohlav", full_scale=saturation, noise=QUIET
    )
    assert (surface.dropped == 7).all()


def test_a_value_is_replaced_by_its_linear_prediction() -> None:
    """i_k = sum c_j i_j with l_k = sum c_j l_j, and then least squares from all four."""
    lighting = Lighting.from_angles([0, 85, 190, 265], [40, 45, 50, 35])
    _, _, images = bumps(lighting)
    images[2] = 0.0
    surface = photometric_stereo(images.astype(np.float32), lighting, "drbohlav", noise=QUIET)
    c = np.linalg.solve(lighting.directions[[0, 1, 3]].T, lighting.directions[2])
    repaired = images.copy()
    repaired[2] = np.tensordot(c, images[[0, 1, 3]], 1)
    b = np.tensordot(np.linalg.pinv(lighting.directions), repaired, 1)
    np.testing.assert_allclose(surface.p, -b[0] / b[2], atol=1e-4)
    np.testing.assert_allclose(surface.q, -b[1] / b[2], atol=1e-4)
    assert (surface.dropped == 2).all()


@pytest.mark.parametrize("light", range(4))
@pytest.mark.parametrize(("method", "atol"), [("drbohlav", 1e-5), ("ps4_robust", 0.01)])
def test_with_four_lights_the_flatter_explanation_decides(
    light: int, method: Method, atol: float
) -> None:
    """On a level surface: a light three times too bright, or at 0.4 of its value.

    ps4_robust leaves in the part of a residual that an error of calibration explains.
    """
    images = np.full((4, 32, 32), 100.0, np.float32)
    images[light, :4] = 300.0
    images[light, 4:8] = 40.0
    surface = photometric_stereo(images, Lighting.ring(), method)
    np.testing.assert_allclose(surface.p, 0.0, atol=atol)
    np.testing.assert_allclose(surface.q, 0.0, atol=atol)
    assert surface.valid.all()
    assert surface.specular[:4].all()
    assert not surface.specular[4:].any()
    assert (surface.shadow_count[4:8] == 1).all()
    assert (surface.dropped[:8] == light).all()
    assert (surface.dropped[8:] == 255).all()


def test_gates_are_quantiles_of_chi_squared() -> None:
    rng = np.random.default_rng(4)
    limits = residual_limits(8)
    assert np.isinf(limits[:4]).all()
    assert limits[4] == pytest.approx(9.0, rel=0.02)
    for lights in (5, 6, 8):
        squares = (rng.standard_normal((200_000, lights - 3)) ** 2).sum(axis=1)
        assert np.mean(squares > limits[lights]) == pytest.approx(0.0027, abs=0.0006)


@pytest.mark.parametrize("pair", list(combinations(range(5), 2)))
def test_two_shadows_of_five_lights_are_found_as_dark(pair: tuple[int, int]) -> None:
    """The residuals do not decide: any three of five lights agree."""
    p, q, images = bumps(ring_of(5))
    images[list(pair)] = 0.0
    surface = photometric_stereo(images.astype(np.float32), ring_of(5), "drbohlav", noise=QUIET)
    np.testing.assert_allclose(surface.p, p, atol=1e-3)
    np.testing.assert_allclose(surface.q, q, atol=1e-3)
    assert surface.valid.all()
