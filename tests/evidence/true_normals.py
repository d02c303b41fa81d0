"""Errors of the solvers on rendered surfaces with known normals and albedo.

    python -m tests.evidence.true_normals [--quick]

Mean angles by solver and number of lights that reach a pixel; rms slope errors beside those of a
prototype, on thirty textures and on scanned materials; glossy materials without a noise model.
--quick measures one seed of four surfaces, and the materials at one slant.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence

import numpy as np

from classify import Lighting, Method, SensorNoise, photometric_stereo
from rig.scene.material_folder import bundled_materials, load_material
from rig.scene.render import Gloss, render_frame
from rig.scene.surfaces import PeriodicSurface
from rig.scene.synthetic import SYNTHETIC_30, SYNTHETIC_NAMES, synthetic_surface
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import SimulatedSet
from tests.angles import normal_errors_deg

from .limits import at_least, at_most

SLANT_DEG = 45.0
METHODS: tuple[Method, ...] = ("ps4", "least_squares", "ps3a", "drbohlav", "ps4_robust")
LIT_BY = ("four", "three", "fewer")
Table = dict[tuple[str, str], float]


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
                error = normal_errors_deg(scene, surface)
                for lights, pixels in zip(LIT_BY, (lit == 4, lit == 3, lit < 3), strict=True):
                    errors.setdefault((method, lights), []).append(error[pixels])
    means = {key: float(np.concatenate(parts).mean()) for key, parts in errors.items()}
    counts = {lights: sum(map(len, errors["ps4", lights])) for lights in LIT_BY}
    return means, {lights: count / sum(counts.values()) for lights, count in counts.items()}


def _solvers_are_as_exact_as_known(bit_depth: int, seeds: int) -> bool:
    means, shares = measure(bit_depth, seeds)
    print(f"\nmean angular error in degrees, slant {SLANT_DEG:g}, {bit_depth} bit, {seeds} seeds")
    print(f"{'lit by':14}" + "".join(f"{lights:>9}" for lights in LIT_BY))
    print(f"{'% of pixels':14}" + "".join(f"{100 * shares[lights]:9.2f}" for lights in LIT_BY))
    for method in METHODS:
        print(f"{method:14}" + "".join(f"{means[method, lights]:9.2f}" for lights in LIT_BY))
    three, four, fewer = (
        {method: means[method, lights] for method in METHODS}
        for lights in ("three", "four", "fewer")
    )
    plain = three["ps4"]
    are_met = [
        at_most("ps4, three lights, degrees", plain, 1.1),
        at_most("ps4, three over four lights", plain / four["ps4"], 1.1),
        # A shadow misleads them; PS3 is exact where it does not use the shadowed light.
        at_least("least_squares over ps4, three lights", three["least_squares"] / plain, 4.0),
        at_least("ps3a over ps4, three lights", three["ps3a"] / plain, 5.0),
        # Omitting one of four good lights: 0.62 against 0.38 degrees in the preparatory study.
        at_most("least_squares, four lights, degrees", four["least_squares"], 0.75),
        at_most("ps4, four lights, degrees", four["ps4"], 1.2),
        at_least("ps4 over least_squares, four lights", four["ps4"] / four["least_squares"], 1.5),
        at_most("ps4 over least_squares, four lights", four["ps4"] / four["least_squares"], 1.75),
        at_most("ps3a over ps4, four lights", four["ps3a"] / four["ps4"], 1.0),
        at_most("least_squares over ps4, fewer", fewer["least_squares"] / fewer["ps4"], 1.0),
        at_most(
            "robust over least_squares, four", four["ps4_robust"] / four["least_squares"], 1.03
        ),
        at_most("robust over ps4, three lights", three["ps4_robust"] / plain, 1.05),
        at_most("robust, fewer lights, degrees", fewer["ps4_robust"], 3.0),
    ]
    # Fewer than three lights do not solve a single pixel.
    for method in ("ps4", "least_squares", "ps3a", "drbohlav"):
        are_met.append(at_least(f"{method}, fewer lights, degrees", fewer[method], 8.0))
        are_met.append(at_most(f"{method}, fewer lights, degrees", fewer[method], 45.0))
    return all(are_met)


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


def _robust_ps4_beats_the_prototype(slant_deg: int, seeds: int) -> bool:
    errors = rms_errors(slant_deg, the_four(seeds, every_combination=seeds > 1))
    show(f"rock, sand, malv, ogil, {seeds} seeds", errors, slant_deg)
    robust, ps4, prototype = errors["ps4_robust"], errors["ps4"], np.array(PROTOTYPE[slant_deg])
    are_met = []
    # Plain PS4 has the errors of the study, so that the surfaces are equally difficult.
    if slant_deg < 70:
        off = np.abs(ps4[:3] / PLAIN_PS4[slant_deg] - 1.0).max()
        are_met.append(at_most("plain ps4 beside the study", off, 0.2))
    if slant_deg == 30:
        # Without shadow no unbiased solution has less noise than least squares.
        off = np.abs(robust[:3] / errors["least_squares"][:3] - 1.0).max()
        are_met.append(at_most("robust beside least_squares", off, 0.01))
    beside = 1.03 if slant_deg == 30 else 1.0
    are_met.append(at_most("robust over the prototype", (robust[:3] / prototype).max(), beside))
    if slant_deg == 70:
        slopes = (robust[:2] / prototype[:2]).max()
        are_met.append(at_most("slopes, robust over the prototype", slopes, 0.45))
        for lights, limit in enumerate((0.8, 0.8, 0.25, 0.4)):
            share = robust[3 + lights] / ps4[3 + lights]
            are_met.append(at_most(f"robust over ps4, {lights} in shadow", share, limit))
    return all(are_met)


def _robust_ps4_is_best_on_thirty_textures(slant_deg: int) -> bool:
    errors = rms_errors(slant_deg, (synthetic_surface(name, 0, 512) for name in SYNTHETIC_30))
    show("thirty textures", errors, slant_deg)
    robust, least_squares, ps4 = (errors[m] for m in ("ps4_robust", "least_squares", "ps4"))
    slopes, albedo = (0.5, 0.6) if slant_deg == 70 else (1.0, 1.0)
    are_met = [
        at_most("robust over least_squares", (robust[:2] / least_squares[:2]).max(), 1.03),
        at_most("slopes, robust over ps4", (robust[:2] / ps4[:2]).max(), slopes),
        at_most("albedo, robust over ps4", robust[2] / ps4[2], albedo),
    ]
    return all(are_met)


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


def _robust_ps4_is_not_worse_on_scanned_materials(slant_deg: float) -> bool:
    found = material_errors(slant_deg, 256)
    print(f"\nrms slope error, scanned materials, slant {slant_deg:g}: ps4 / ps4_robust")
    print(f"{'lights in shadow':22}" + "".join(f"{head:>14}" for head in (*"0123", "all")))
    for name, (ps4, robust) in found.items():
        cells = (f"{a:7.3f}/{b:5.3f} " for a, b in zip(ps4, robust, strict=True))
        print(f"{name:22}" + "".join(cells))
    shares = np.array([robust / ps4 for ps4, robust in found.values()])
    are_met = [
        at_most("robust over ps4, any number in shadow", float(np.nanmax(shares)), 1.1),
        at_most("robust over ps4, all pixels", float(shares[:, 4].max()), 0.9),
    ]
    return all(are_met)


GLOSS_METHODS: tuple[Method, ...] = ("least_squares", "ps4_robust")
GLOSSES = (Gloss(0.05, 20.0), Gloss(0.1, 8.0), Gloss(0.3, 20.0), Gloss(0.6, 80.0))


def _robust_ps4_is_better_than_least_squares_on_gloss(slant_deg: float) -> bool:
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
                row.append(float(normal_errors_deg(scene, surface).mean()))
        print(
            f"{name:22}"
            + " ".join(f"{a:7.2f}/{b:5.2f}" for a, b in zip(row[::2], row[1::2], strict=True))
        )
        table.append(row)
    errors = np.array(table)
    ratios = errors[:, 1::2] / errors[:, ::2]
    print(f"{'mean ratio':22}" + " ".join(f"{ratio:13.3f}" for ratio in ratios.mean(axis=0)))
    are_met = [at_most("robust over least_squares, mean", float(ratios.mean()), 1.0)]
    if slant_deg == 35:  # no shadows
        are_met.append(at_most("robust over least_squares", float(ratios.max()), 1.03))
    return all(are_met)


def main(arguments: Sequence[str]) -> int:
    """Print the tables; return 1 if a figure is beyond its limit."""
    parser = argparse.ArgumentParser(prog="true_normals")
    parser.add_argument("--quick", action="store_true")
    if parser.parse_args(arguments).quick:
        are_met = [
            _solvers_are_as_exact_as_known(8, 1),
            _robust_ps4_beats_the_prototype(70, 1),
            _robust_ps4_is_not_worse_on_scanned_materials(70.0),
        ]
        return int(not all(are_met))
    are_met = [_solvers_are_as_exact_as_known(bits, 3) for bits in (8, 16)]
    for slant_deg in (30, 50, 70):
        are_met.append(_robust_ps4_beats_the_prototype(slant_deg, 3))
        are_met.append(_robust_ps4_is_best_on_thirty_textures(slant_deg))
    are_met += [_robust_ps4_is_not_worse_on_scanned_materials(slant) for slant in (45.0, 70.0)]
    are_met += [
        _robust_ps4_is_better_than_least_squares_on_gloss(slant) for slant in (35.0, 45.0, 55.0)
    ]
    return int(not all(are_met))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
