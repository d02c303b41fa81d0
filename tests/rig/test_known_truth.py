"""Errors of the solvers on rendered surfaces with known normals and albedo.

``pytest tests/rig/test_known_truth.py -s`` prints the tables. The slow tests measure more surfaces:
all seeds and combinations, the thirty textures, and the scanned materials.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from classify import Lighting, Method, SensorNoise, SurfaceEstimate, photometric_stereo
from rig.scene.material_folder import bundled_materials, load_material
from rig.scene.render import Gloss, SceneImages, render_frame
from rig.scene.surfaces import PeriodicSurface
from rig.scene.synthetic import SYNTHETIC_30, SYNTHETIC_NAMES, synthetic_surface
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import SimulatedSet

SLANT_DEG = 45.0
METHODS: tuple[Method, ...] = ("ps4", "least_squares", "ps3a", "drbohlav", "ps4_robust")
LIT_BY = ("four", "three", "fewer")
Table = dict[tuple[str, str], float]


def angular_error_deg(scene: SceneImages, surface: SurfaceEstimate) -> np.ndarray:
    truth = np.stack([-scene.p, -scene.q, np.ones_like(scene.p)], axis=-1).astype(float)
    found = surface.normals.astype(float)
    across = np.linalg.norm(np.cross(truth, found), axis=-1)
    return np.degrees(np.arctan2(across, (truth * found).sum(axis=-1)))


def measure(bit_depth: int, seeds: int) -> tuple[Table, dict[str, float]]:
    """Mean error in degrees by method and number of lights, and the share of such pixels.

    Every pixel counts, also invalid ones, which a method leaves level.
    """
    lighting = Lighting.ring(SLANT_DEG)
    sensor = SensorModel(bit_depth=bit_depth)
    errors: dict[tuple[str, str], list[np.ndarray]] = {}
    for name in SYNTHETIC_NAMES:
        for seed in range(seeds):
            scene = render_frame(synthetic_surface(name, seed, 512), lighting, 256)
            lit = 4 - scene.shadowed.sum(axis=0)
            for method in METHODS:
                surface = SimulatedSet.expose(scene, lighting, sensor, seed).solve(method)
                error = angular_error_deg(scene, surface)
                for lights, pixels in zip(LIT_BY, (lit == 4, lit == 3, lit < 3), strict=True):
                    errors.setdefault((method, lights), []).append(error[pixels])
    means = {key: float(np.concatenate(parts).mean()) for key, parts in errors.items()}
    counts = {lights: sum(map(len, errors["ps4", lights])) for lights in LIT_BY}
    return means, {lights: count / sum(counts.values()) for lights, count in counts.items()}


@pytest.fixture(
    scope="module",
    params=[
        (8, 1),
        pytest.param((8, 3), marks=pytest.mark.slow),
        pytest.param((16, 3), marks=pytest.mark.slow),
    ],
    ids=["8 bit, 1 seed", "8 bit, 3 seeds", "16 bit, 3 seeds"],
)
def table(request: pytest.FixtureRequest) -> Table:
    bit_depth, seeds = request.param
    means, shares = measure(bit_depth, seeds)
    print(f"\nmean angular error in degrees, slant {SLANT_DEG:g}, {bit_depth} bit")
    print(f"{'lit by':14}" + "".join(f"{lights:>9}" for lights in LIT_BY))
    print(f"{'% of pixels':14}" + "".join(f"{100 * shares[lights]:9.2f}" for lights in LIT_BY))
    for method in METHODS:
        print(f"{method:14}" + "".join(f"{means[method, lights]:9.2f}" for lights in LIT_BY))
    return means


def test_ps4_is_as_exact_with_three_lights_as_with_four(table: Table) -> None:
    assert table["ps4", "three"] < 1.1
    assert table["ps4", "three"] < 1.1 * table["ps4", "four"]


def test_a_shadow_misleads_least_squares_and_ps3(table: Table) -> None:
    """PS3 is exact at pixels whose shadowed light it does not use, and wrong at the others."""
    assert table["least_squares", "three"] > 4.0 * table["ps4", "three"]
    assert table["ps3a", "three"] > 5.0 * table["ps4", "three"]


def test_without_shadow_least_squares_has_the_least_noise(table: Table) -> None:
    # Omitting one of four good lights: 0.62 against 0.38 degrees in the preparatory study.
    assert table["least_squares", "four"] < 0.75
    assert table["ps4", "four"] < 1.2
    assert 1.5 < table["ps4", "four"] / table["least_squares", "four"] < 1.75
    assert table["ps3a", "four"] < table["ps4", "four"]


def test_fewer_than_three_lights_do_not_solve_a_single_pixel(table: Table) -> None:
    for method in ("ps4", "least_squares", "ps3a", "drbohlav"):
        assert 8.0 < table[method, "fewer"] < 45.0
    assert table["least_squares", "fewer"] < table["ps4", "fewer"]


def test_robust_ps4_is_as_exact_as_the_best_method_for_each_number_of_lights(table: Table) -> None:
    assert table["ps4_robust", "four"] < 1.03 * table["least_squares", "four"]
    assert table["ps4_robust", "three"] < 1.05 * table["ps4", "three"]
    assert table["ps4_robust", "fewer"] < 3.0


# Mean rms error of p, q and albedo over thirty surfaces with cast shadow, 8 bit, 2 DN of noise, by
# slant: plain PS4, and a prototype with a noise gate and two-shadow rules, both measured in the
# preparatory study of this project.
PLAIN_PS4 = {30: (0.027, 0.027, 0.0066), 50: (0.022, 0.022, 0.0077), 70: (0.283, 0.176, 0.066)}
PROTOTYPE = {30: (0.019, 0.019, 0.0059), 50: (0.015, 0.016, 0.0065), 70: (0.079, 0.081, 0.019)}
SIGMA_DN = 2.0
MEAN_ALBEDO = 0.7
SHOWN: tuple[Method, ...] = ("ps3a", "ps4", "least_squares", "drbohlav", "ps4_robust")
Errors = dict[str, np.ndarray]


def patterned(side: int, seed: int) -> np.ndarray:
    """Albedo in soft patches of about ten pixels, with a deviation of a seventh."""
    rng = np.random.default_rng([seed, 77])
    frequency = np.hypot(np.fft.rfftfreq(side), np.fft.fftfreq(side)[:, None])
    spectrum = np.fft.rfft2(rng.standard_normal((side, side))) * np.exp(-555 * frequency**2)
    field = np.fft.irfft2(spectrum, s=(side, side))
    return np.clip(MEAN_ALBEDO + 0.1 * field / field.std(), 0.2, 0.95)


def of_slope(name: str, seed: int, rms_slope: float, flat: bool) -> PeriodicSurface:
    height = synthetic_surface(name, seed, 512).height * np.float32(rms_slope / 0.5)
    albedo = np.full(height.shape, MEAN_ALBEDO) if flat else patterned(512, seed)
    return PeriodicSurface.from_height(height, albedo, name)


def the_four(seeds: int, every_combination: bool) -> Iterator[PeriodicSurface]:
    """Rock, sand, malv and ogil at rms slopes 0.4 and 0.5, with even and patterned albedo."""
    for name in SYNTHETIC_NAMES:
        for seed in range(seeds):
            for rms_slope in (0.4, 0.5):
                for flat in (True, False):
                    if every_combination or flat == (rms_slope == 0.4):
                        yield of_slope(name, seed, rms_slope, flat)


def rms_errors(slant_deg: float, surfaces: Iterator[PeriodicSurface]) -> Errors:
    """Rms errors averaged over the surfaces: p, q, albedo; slopes with 0, 1, 2, 3 shadows."""
    lighting = Lighting.ring(slant_deg)
    rows: dict[str, list[np.ndarray]] = {}
    for index, surface in enumerate(surfaces):
        scene = render_frame(surface, lighting, 256, ambient=0.0)
        noise = SIGMA_DN * np.random.default_rng(index).standard_normal(scene.lights.shape)
        images = np.clip(np.rint(255.0 * scene.lights + noise), 0, 255).astype(np.uint8)
        shadows = np.minimum(scene.shadowed.sum(axis=0), 3)
        for method in SHOWN:
            found = photometric_stereo(
                images, lighting, method, full_scale=255, noise=SensorNoise(1e9, SIGMA_DN)
            )
            squares = np.stack([
                (found.p - scene.p) ** 2, (found.q - scene.q) ** 2,
                (found.albedo - scene.albedo) ** 2,
            ])  # fmt: skip
            overall = squares.mean(axis=(1, 2))
            parts = [
                squares[:2, shadows == n].mean() if (shadows == n).sum() > 50 else np.nan
                for n in range(4)
            ]
            rows.setdefault(method, []).append(np.sqrt(np.concatenate([overall, parts])))
    with np.errstate(invalid="ignore"):
        return {
            method: np.ma.masked_invalid(values).mean(axis=0).filled(np.nan)
            for method, values in rows.items()
        }


def show(title: str, errors: Errors, slant_deg: int) -> None:
    print(f"\n{title}, slant {slant_deg}: rms error, 8 bit, {SIGMA_DN:g} DN of noise")
    print(f"{'':16}" + "".join(f"{head:>9}" for head in ("p", "q", "albedo", *"0123")))
    for method, values in errors.items():
        print(f"{method:16}" + "".join(f"{value:9.4f}" for value in values))
    for label, known in (("plain PS4", PLAIN_PS4), ("prototype", PROTOTYPE)):
        print(f"{label:16}" + "".join(f"{value:9.4f}" for value in known[slant_deg]))


@pytest.mark.parametrize(
    ("slant_deg", "seeds"),
    [
        (70, 1),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in ((30, 3), (50, 3), (70, 3))),
    ],
)
def test_robust_ps4_beats_the_prototype(slant_deg: int, seeds: int) -> None:
    errors = rms_errors(slant_deg, the_four(seeds, every_combination=seeds > 1))
    show(f"rock, sand, malv, ogil, {seeds} seeds", errors, slant_deg)
    check_against_prototype(errors, slant_deg)


@pytest.mark.slow
@pytest.mark.parametrize("slant_deg", [30, 50, 70])
def test_robust_ps4_is_best_on_thirty_textures(slant_deg: int) -> None:
    errors = rms_errors(slant_deg, (synthetic_surface(name, 0, 512) for name in SYNTHETIC_30))
    show("thirty textures", errors, slant_deg)
    robust, least_squares, ps4 = (errors[m] for m in ("ps4_robust", "least_squares", "ps4"))
    assert (robust[:2] < 1.03 * least_squares[:2]).all()
    assert (robust[:3] < ps4[:3]).all()
    if slant_deg == 70:
        assert (robust[:2] < 0.5 * ps4[:2]).all()
        assert robust[2] < 0.6 * ps4[2]


def check_against_prototype(errors: Errors, slant_deg: int) -> None:
    robust, ps4 = errors["ps4_robust"], errors["ps4"]
    # Plain PS4 has the errors of the study, so that the surfaces are equally difficult.
    if slant_deg < 70:
        np.testing.assert_allclose(ps4[:3], PLAIN_PS4[slant_deg], rtol=0.2)
    if slant_deg == 30:
        # Without shadow no unbiased solution has less noise than least squares.
        np.testing.assert_allclose(robust[:3], errors["least_squares"][:3], rtol=0.01)
        assert (robust[:3] < 1.03 * np.array(PROTOTYPE[30])).all()
    else:
        assert (robust[:3] < PROTOTYPE[slant_deg]).all()
    if slant_deg == 70:
        assert (robust[:2] < 0.45 * np.array(PROTOTYPE[70])[:2]).all()
        assert (robust[3:] < (0.8, 0.8, 0.25, 0.4) * ps4[3:]).all()


def material_errors(slant_deg: float, size_px: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Rms slope error of ps4 and ps4_robust with 0, 1, 2, 3 shadows and overall, 12 bit.

    Errors are limited to 5: edges of a scan have slopes of 10, which no method finds.
    """
    lighting = Lighting.ring(slant_deg)
    sensor = SensorModel(bit_depth=12)
    found = {}
    for name, folder in bundled_materials().items():
        scene = render_frame(load_material(folder), lighting, size_px, 20.0, (37.0, 11.0))
        shadows = np.minimum(scene.shadowed.sum(axis=0), 3)
        methods: tuple[Method, ...] = ("ps4", "ps4_robust")
        both = []
        for method in methods:
            surface = SimulatedSet.expose(scene, lighting, sensor, 1).solve(method)
            error = np.hypot(surface.p - scene.p, surface.q - scene.q) / np.sqrt(2.0)
            squares = np.minimum(error, 5.0) ** 2
            groups = [squares[shadows == n] for n in range(4)] + [squares.ravel()]
            both.append([g.mean() ** 0.5 if g.size > 200 else np.nan for g in groups])
        found[name] = np.array(both[0]), np.array(both[1])
    return found


@pytest.mark.slow
@pytest.mark.parametrize("slant_deg", [45.0, 70.0])
def test_robust_ps4_is_not_worse_on_scanned_materials(slant_deg: float) -> None:
    found = material_errors(slant_deg, 256)
    print(f"\nrms slope error, scanned materials, slant {slant_deg:g}: ps4 / ps4_robust")
    print(f"{'lights in shadow':22}" + "".join(f"{head:>14}" for head in (*"0123", "all")))
    for name, (ps4, robust) in found.items():
        cells = (f"{a:7.3f}/{b:5.3f} " for a, b in zip(ps4, robust, strict=True))
        print(f"{name:22}" + "".join(cells))
    for ps4, robust in found.values():
        counted = ~np.isnan(ps4)
        assert (robust <= 1.1 * ps4)[counted].all()
        assert robust[4] < 0.9 * ps4[4]


GLOSS_METHODS: tuple[Method, ...] = ("least_squares", "ps4_robust")
GLOSSES = (Gloss(0.05, 20.0), Gloss(0.1, 8.0), Gloss(0.3, 20.0), Gloss(0.6, 80.0))


@pytest.mark.slow
@pytest.mark.parametrize("slant_deg", [35.0, 45.0, 55.0])
def test_robust_ps4_is_better_than_least_squares_on_gloss(slant_deg: float) -> None:
    """Mean angle to the true normals, without a noise model, where most pixels have highlights."""
    lighting = Lighting.ring(slant_deg)
    sensor = SensorModel(bit_depth=12)
    print(f"\nmean error, degrees, slant {slant_deg:g}: least_squares / ps4_robust")
    table = []
    for name, folder in bundled_materials().items():
        material, row = load_material(folder), []
        for gloss in GLOSSES:
            scene = render_frame(material, lighting, 256, gloss=gloss)
            taken = SimulatedSet.expose(scene, lighting, sensor, 1)
            for method in GLOSS_METHODS:
                surface = photometric_stereo(taken.images, lighting, method, ambient=taken.ambient)
                row.append(float(angular_error_deg(scene, surface).mean()))
        print(
            f"{name:22}"
            + " ".join(f"{a:7.2f}/{b:5.2f}" for a, b in zip(row[::2], row[1::2], strict=True))
        )
        table.append(row)
    errors = np.array(table)
    ratios = errors[:, 1::2] / errors[:, ::2]
    print(f"{'mean ratio':22}" + " ".join(f"{ratio:13.3f}" for ratio in ratios.mean(axis=0)))
    assert ratios.mean() < 1.0
    if slant_deg == 35:  # no shadows
        assert (ratios < 1.03).all()
