"""`ps4rig reproduce`: plans, patches and counts, and a small reproduction with all files."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.chapter.exhibits import reproduce
from capture.chapter.plan import (
    Conditions,
    Experiment,
    PatchPosition,
    Plan,
    Texture,
    plan_of,
    thirty_textures,
)
from capture.chapter.results import Trials
from capture.chapter.runs import CachedPatch, System, render_patch, solve
from classify import Match, Trial
from rig import SYNTHETIC_30, SYNTHETIC_TEXTURES
from rig.scene.material_folder import bundled_materials
from rig.scene.surfaces import PeriodicSurface
from tests.html_page import self_contained

Rows = list[dict[str, str]]

SAND = PatchPosition(Texture("sand"), seed=3, shift_tiles=(0.0, 0.0), rotate_deg=20.0)
FIGURES = ("01", "02", "03", "05", "07", "08", "09", "10", "11", "13")
TABLES = ("summary", "table_9_01")


# plans


@pytest.mark.parametrize("quick", [False, True])
def test_a_plan_has_many_orientations_and_no_multiple_of_90(quick: bool) -> None:
    for experiment in plan_of(quick).experiments:
        orientations_deg = experiment.orientations_deg
        assert len(set(orientations_deg)) == len(orientations_deg) >= 12
        assert all(0.0 < deg < 200.0 for deg in orientations_deg)
        assert min(abs((deg + 45.0) % 90.0 - 45.0) for deg in orientations_deg) > 1.0


def test_the_full_plan_has_all_textures_and_sizes() -> None:
    plan = plan_of(False)
    names = [texture.name for texture in thirty_textures(False)]
    assert len(set(names)) == len(names) == 30
    assert set(bundled_materials()) <= set(names)
    assert len(set(names) & set(SYNTHETIC_30)) == 22
    assert {texture.name for texture in plan.slants.textures} == set(SYNTHETIC_TEXTURES[:4])
    many = [run for run in plan.thirty.training if len(run.orientations_deg) > 1]
    assert many
    assert all(4 * len(run.orientations_deg) == 28 for run in many)


def test_disjoint_tests_are_other_realisations_and_other_places() -> None:
    experiment = plan_of(False).thirty
    sand, bark = Texture("sand"), Texture("Bark014", bundled_materials()["Bark014"])
    seeds = {experiment.test_position(sand, i, "disjoint").seed for i in range(24)}
    assert len(seeds - {0}) == 24
    assert experiment.test_position(sand, 5, "rotated").seed == 0
    assert experiment.test_position(bark, 5, "disjoint").shift_tiles == (0.5, 0.5)
    assert experiment.test_position(bark, 5, "rotated").shift_tiles == (0.0, 0.0)


def test_training_sets_are_of_one_patch_or_of_several_that_are_not_tested() -> None:
    plan, sand = plan_of(False), Texture("sand")
    for experiment in plan.experiments:
        for run in experiment.training:
            positions = run.positions(sand)
            assert [each.rotate_deg for each in positions] == list(run.orientations_deg)
            patches = {(each.seed, each.shift_tiles) for each in positions}
            assert len(patches) == len(run.places)
            for number in range(len(experiment.orientations_deg)):
                tested = experiment.test_position(sand, number, "disjoint")
                assert tested.seed not in {seed for seed, _ in patches}
                assert tested.shift_tiles not in {shift for _, shift in patches}


# patches


@pytest.mark.parametrize("rotate_deg", [0.0, 30.0, 45.0])
def test_a_patch_half_a_tile_away_shares_no_pixel_with_training(rotate_deg: float) -> None:
    flat = np.zeros((512, 512), np.float32)
    marked = np.full_like(flat, 0.2)
    marked[128:384, 128:384] = 1.0
    surface = PeriodicSurface(flat, flat, flat, marked, "marked")
    training = PatchPosition(Texture("marked"), 0, shift_tiles=(0.0, 0.0), rotate_deg=0.0)
    assert render_patch(training, 45.0, 256, surface).albedo[2:-2, 2:-2].min() > 0.9
    test = replace(training, shift_tiles=(0.5, 0.5), rotate_deg=rotate_deg)
    # The squares touch at a corner.
    assert (render_patch(test, 45.0, 256, surface).albedo > 0.6).sum() <= 8


def test_the_images_of_a_patch_depend_on_position_and_conditions_only() -> None:
    conditions = Conditions(50.0, 64)
    first, second = (CachedPatch(SAND, 128).images(conditions).images for _ in range(2))
    np.testing.assert_array_equal(first, second)
    other = CachedPatch(replace(SAND, rotate_deg=21.0), 128).images(conditions).images
    assert not np.array_equal(first, other)
    weak = CachedPatch(SAND, 128).images(replace(conditions, weak_led=0.5)).images
    assert weak[1].mean() < 0.6 * first[1].mean()
    short = CachedPatch(SAND, 128).images(replace(conditions, exposure=0.5)).images
    assert short.mean() < 0.6 * first.mean()


def test_smaller_frames_are_the_middle_of_larger_ones() -> None:
    patch = CachedPatch(SAND, 128)
    large = solve(patch.images(Conditions(40.0, 128)), "ps4").p[32:96, 32:96]
    small = solve(patch.images(Conditions(40.0, 64)), "ps4").p
    assert np.abs(large - small).mean() < 0.03


# counts


def match_of(nearest: str, found_deg: float, sharpness: float = 0.9, known: bool = True) -> Match:
    label = nearest if known else None
    return Match(label, nearest, found_deg, 1.0, None, None, None, sharpness=sharpness)


def test_accuracy_counts_the_nearest_class() -> None:
    ours = System("e", "x", "ps4", "joint")
    trials = [
        Trial("sand", 179.0, match_of("sand", 1.0)),
        Trial("sand", 20.0, match_of("sand", 21.0)),
        Trial("sand", 20.0, match_of("rock", 70.0)),
        Trial("sand", 20.0, match_of("sand", 60.0, sharpness=0.2)),
        Trial("rock", 5.0, match_of("rock", 5.0, known=False)),
    ]
    results = Trials({ours: trials})
    assert results.accuracy_pct(*ours) == pytest.approx(80.0)
    assert results.accuracy_pct(*ours, texture="rock") == 100.0
    assert results.accuracy_pct("e", "x", "ps3a", "joint") is None


# a small reproduction


def cut(experiment: Experiment, names: tuple[str, ...], tests: int) -> Experiment:
    """All test runs with few textures and few tests."""
    runs = []
    for run in experiment.tests:
        textures = tuple(t for t in run.training.textures if t.name in names)
        runs.append(replace(run, training=replace(run.training, textures=textures)))
    orientations_deg = experiment.orientations_deg
    kept_deg = orientations_deg[:: len(orientations_deg) // tests][:tests]
    return replace(experiment, tests=tuple(runs), orientations_deg=kept_deg)


def _small_plan() -> Plan:
    plan = plan_of(True)
    return replace(
        plan,
        slants=cut(plan.slants, SYNTHETIC_TEXTURES[:4], 4),
        thirty=cut(plan.thirty, ("rock", "ogil_long", "marble", "Bark014"), 3),
    )


@pytest.fixture(scope="module")
def reproduction(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reproduction") / "out"
    assert reproduce(_small_plan(), folder) == folder / "reproduction.html"
    return folder


def _csv(folder: Path, key: str) -> Rows:
    with (folder / f"{key}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_every_figure_and_table_is_written(reproduction: Path) -> None:
    keys = [f"figure_9_{number}" for number in FIGURES] + list(TABLES)
    figures = [*keys[: len(FIGURES)]]
    expected = {*(f"{key}.csv" for key in keys), *(f"{key}.png" for key in figures)}
    files = {path.name for path in reproduction.iterdir()}
    assert files == expected | {"reproduction.html", "results.json"}
    for key in keys:
        assert _csv(reproduction, key)
    for key in figures:
        assert (reproduction / f"{key}.png").read_bytes().startswith(b"\x89PNG")
    numbers = json.loads((reproduction / "results.json").read_text(encoding="utf-8"))
    assert numbers["simulated"] is True
    assert set(numbers["exhibits"]) == set(keys)


@pytest.mark.slow
def test_the_page_is_self_contained(reproduction: Path) -> None:
    html = self_contained(reproduction / "reproduction.html")
    assert "<b>Simulated.</b>" in html
    assert "Quick version" in html
    assert "$" not in html
    for number in ("90.56", "95.93", "99.07", "95.83"):
        assert number in html


@pytest.mark.slow
def test_four_lights_are_more_accurate_than_three_in_shadow(reproduction: Path) -> None:
    rows = [r for r in _csv(reproduction, "figure_9_01") if r["classifier"] == "polar_radial"]
    accuracy = {
        (row["shadow"], float(row["slant_deg"]), row["solver"]): float(row["accuracy_pct"])
        for row in rows
    }
    # At slant 60 the noise of these small patches decides between PS3 and PS4.
    assert accuracy["with", 80.0, "ps4"] > accuracy["with", 80.0, "ps3a"] + 5.0
    for slant_deg in (60.0, 80.0):
        assert accuracy["without", slant_deg, "ps3a"] > accuracy["with", slant_deg, "ps3a"] + 5.0
    errors = {r["solver"]: float(r["rms_error_p"]) for r in _csv(reproduction, "figure_9_08")}
    assert errors["ps4_robust"] < 0.5 * errors["ps4"] < 0.5 * errors["ps3a"]


@pytest.mark.slow
def test_joint_matches_or_beats_2d_spectra_on_disjoint_patches(reproduction: Path) -> None:
    rows = [r for r in _csv(reproduction, "figure_9_13") if r["protocol"] == "disjoint"]
    assert rows
    accuracy = {
        (r["slant_deg"], r["solver"], r["classifier"]): float(r["accuracy_pct"]) for r in rows
    }
    for (slant_deg, solver, classifier), value in accuracy.items():
        if classifier == "joint" and solver != "ps3a":
            assert value >= accuracy[slant_deg, solver, "spectra_2d"]
            assert value > 90.0


@pytest.mark.slow
def test_tables_have_the_numbers_of_the_thesis(reproduction: Path) -> None:
    rows = {row["system"]: row["thesis, %"] for row in _csv(reproduction, "summary")}
    assert rows["PS3, 1D"] == "90.56"
    assert rows["PS4, 2D"] == "99.07"
    costs = _csv(reproduction, "table_9_01")
    assert {row["training images a class"] for row in costs} == {"4", "28"}
    assert all(float(row["together, ms"]) > 0.0 for row in costs)
