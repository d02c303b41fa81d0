"""`ps4rig reproduce`: plans, patches and counts, and a small reproduction with all files."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.chapter import output
from capture.chapter.exhibit import Exhibit
from capture.chapter.faults import NO_FAULTS, Faults
from capture.chapter.output import About, page
from capture.chapter.patches import CachedPatch, render_patch, solve
from capture.chapter.plan import (
    Conditions,
    Experiment,
    PatchPosition,
    Plan,
    Texture,
    material_textures,
    plan_of,
    thirty_textures,
)
from capture.chapter.rejection import accepted_pct, rejection_curve
from capture.chapter.results import Results, answers_pct
from capture.chapter.run import reproduce
from capture.chapter.runs import Outcome, System, without_class
from capture.chapter.sand import SHADOW_TILTS_DEG, SandMaps, shadow_shares
from classify import Match, TextureLibrary, Trial
from rig import EQUAL_SPECTRUM_TWINS, SYNTHETIC_30, SYNTHETIC_TEXTURES
from rig.scene.material_folder import bundled_materials
from rig.scene.surfaces import PeriodicSurface
from tests.html_page import self_contained

Rows = list[dict[str, str]]

SAND = PatchPosition(Texture("sand"), seed=3, shift_tiles=(0.0, 0.0), rotate_deg=20.0)
FIGURES = ("01", "02", "03", "05", "07", "08", "09", "10", "11", "13")
TABLES = (
    "summary", "table_9_01", "classifiers_synthetic", "classifiers_twins_and_small", "materials",
    "orientation", "robustness", "unknown", "unknown_curves", "days", "open_set",
)  # fmt: skip


# plans


@pytest.mark.parametrize("quick", [False, True])
def test_a_plan_has_many_orientations_and_no_multiple_of_90(quick: bool) -> None:
    for experiment in plan_of(quick, material_textures(None)).experiments:
        orientations_deg = experiment.orientations_deg
        assert len(set(orientations_deg)) == len(orientations_deg) >= 12
        assert all(0.0 < deg < 200.0 for deg in orientations_deg)
        assert min(abs((deg + 45.0) % 90.0 - 45.0) for deg in orientations_deg) > 1.0


def test_the_full_plan_has_all_textures_and_sizes() -> None:
    plan = plan_of(False, material_textures(None))
    names = [texture.name for texture in thirty_textures(False)]
    assert len(set(names)) == len(names) == 30
    assert set(bundled_materials()) <= set(names)
    assert len(set(names) & set(SYNTHETIC_30)) == 22
    assert {texture.name for texture in plan.slants.textures} == set(SYNTHETIC_TEXTURES[:4])
    tests = {test.name: test for test in plan.synthetic.tests}
    assert {t.name for t in tests["slant 50"].training.textures} == set(SYNTHETIC_30)
    twins = {t.name for t in tests["slant 50, twins"].training.textures}
    assert twins == set(SYNTHETIC_30) | set(EQUAL_SPECTRUM_TWINS)
    assert tests["slant 50, small"].conditions.size_px == 128
    sizes = {test.conditions.size_px for test in plan.materials.tests}
    assert sizes == {128, 256, 320}
    assert plan.robustness.frame_px == 512
    many = [run for run in plan.thirty.training if len(run.orientations_deg) > 1]
    assert many
    assert all(4 * len(run.orientations_deg) == 28 for run in many)


def test_disjoint_tests_are_other_realisations_and_other_places() -> None:
    experiment = plan_of(False, material_textures(None)).thirty
    sand, bark = Texture("sand"), Texture("Bark014", bundled_materials()["Bark014"])
    seeds = {experiment.test_position(sand, i, "disjoint").seed for i in range(24)}
    assert len(seeds - {0}) == 24
    assert experiment.test_position(sand, 5, "rotated").seed == 0
    assert experiment.test_position(bark, 5, "disjoint").shift_tiles == (0.5, 0.5)
    assert experiment.test_position(bark, 5, "rotated").shift_tiles == (0.0, 0.0)


def test_training_sets_are_of_one_patch_or_of_several_that_are_not_tested() -> None:
    plan, sand = plan_of(False, material_textures(None)), Texture("sand")
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
    for experiment in (plan.days, plan.small_frames):
        assert {len(run.positions(sand)) for run in experiment.training} == {1, 3}


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


@pytest.mark.parametrize("rotate_deg", [0.0, 30.0, 45.0])
def test_small_frames_share_no_pixel_and_contain_no_seam(rotate_deg: float) -> None:
    experiment = plan_of(False, material_textures(None)).small_frames
    trained = {place for run in experiment.training for place in run.places}
    assert len(trained | set(experiment.tested_places)) == 9
    flat = np.zeros((512, 512), np.float32)
    marked = np.full_like(flat, 0.2)
    marked[2:-2, 2:-2] = 0.6
    for right, up in trained:
        row, column = (256 + round(512 * shift) for shift in (-up, right))
        marked[row - 62 : row + 62, column - 62 : column + 62] = 1.0
    surface = PeriodicSurface(flat, flat, flat, marked, "marked")
    for place in experiment.tested_places:
        test = PatchPosition(Texture("marked"), 0, place, rotate_deg)
        albedo = render_patch(test, 45.0, 128, surface).albedo
        assert 0.4 < albedo.min() < albedo.max() < 0.7


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


def test_every_set_draws_its_own_faults_within_the_bounds() -> None:
    usual = Conditions(45.0, 64)

    def mean_levels(position: PatchPosition, faults: Faults = NO_FAULTS) -> np.ndarray:
        images = CachedPatch(position, 64).images(replace(usual, faults=faults)).images
        return images.mean(axis=(1, 2)) - 64.0  # less the black level

    weak = mean_levels(SAND, Faults(weak_leds=0.5)) / mean_levels(SAND)
    assert 0.45 < weak.min() < weak.max() - 0.05 < 0.95
    np.testing.assert_array_equal(
        weak, mean_levels(SAND, Faults(weak_leds=0.5)) / mean_levels(SAND)
    )
    other = replace(SAND, rotate_deg=21.0)
    elsewhere = mean_levels(other, Faults(weak_leds=0.5)) / mean_levels(other)
    assert np.abs(elsewhere - weak).min() > 0.01
    added = mean_levels(SAND, Faults(ambient=0.1)) - mean_levels(SAND)
    np.testing.assert_allclose(added, added.mean(), rtol=0.02)
    ambient = CachedPatch(SAND, 64).images(replace(usual, faults=Faults(ambient=0.1))).ambient
    np.testing.assert_array_equal(ambient, CachedPatch(SAND, 64).images(usual).ambient)


def test_smaller_frames_are_the_middle_of_larger_ones() -> None:
    patch = CachedPatch(SAND, 128)
    large = solve(patch.images(Conditions(40.0, 128)), "ps4").p[32:96, 32:96]
    small = solve(patch.images(Conditions(40.0, 64)), "ps4").p
    assert np.abs(large - small).mean() < 0.03


def test_sand_has_the_shadow_counts_of_the_thesis() -> None:
    for slant_deg, percent in ((40.0, 1.0), (60.0, 19.0), (80.0, 61.0)):
        shares = dict(zip(SHADOW_TILTS_DEG, shadow_shares(("sand", slant_deg)), strict=True))
        assert 100.0 * shares[0.0] == pytest.approx(percent, abs=2.0)
        assert shares[0.0] > shares[90.0]


# counts


def _match(nearest: str, found_deg: float, sharpness: float = 0.9, known: bool = True) -> Match:
    label = nearest if known else None
    return Match(label, nearest, found_deg, 1.0, None, None, None, sharpness=sharpness)


def test_accuracy_counts_the_nearest_class_and_errors_are_modulo_180() -> None:
    ours = System("e", "x", "ps4", "joint")
    trials = [
        Trial("sand", 179.0, _match("sand", 1.0)),
        Trial("sand", 20.0, _match("sand", 21.0)),
        Trial("sand", 20.0, _match("rock", 70.0)),
        Trial("sand", 20.0, _match("sand", 60.0, sharpness=0.2)),
        Trial("rock", 5.0, _match("rock", 5.0, known=False)),
    ]
    plan = plan_of(True, material_textures(None))
    outcomes = {ours: [Outcome(ours, trial, None) for trial in trials]}
    results = Results(plan, outcomes, {}, {}, SandMaps({}, {}, {}, {}), [])
    assert results.accuracy_pct(*ours) == pytest.approx(80.0)
    assert results.accuracy_pct(*ours, texture="rock") == 100.0
    assert results.orientation_errors_deg(ours) == pytest.approx([2.0, 1.0, 0.0])
    assert results.accuracy_pct("e", "x", "ps3a", "joint") is None


def test_a_library_without_a_class_matches_another_one() -> None:
    patches = {
        name: CachedPatch(replace(SAND, texture=Texture(name)), 64).surface(
            Conditions(45.0, 64), "ps4"
        )
        for name in ("sand", "rock", "malv")
    }
    library = TextureLibrary.train(list(patches.items()))
    assert library.classify(patches["sand"]).nearest == "sand"
    without = without_class(library, "sand")
    assert without.classify(patches["sand"]).nearest in ("rock", "malv")
    # A limit never exceeds the distance to the nearest other class, which is no longer sand.
    assert without.limits.keys() == {"rock", "malv"}
    assert all(without.limits[label] >= library.limits[label] for label in without.limits)


def test_unknown_is_accepted_up_to_the_limit_that_keeps_the_known() -> None:
    known = np.arange(100.0)
    unknown = 50.0 + known
    for share, percent in ((0.0, 50.0), (0.01, 49.0), (0.6, 0.0)):
        assert accepted_pct(known, unknown, share) == pytest.approx(percent)
    rejected, accepted = rejection_curve(known, unknown)
    assert rejected[0] == 0.0
    assert accepted[0] == pytest.approx(50.0)
    assert accepted[1] == pytest.approx(49.0)
    assert accepted == sorted(accepted, reverse=True)


def test_answers_are_right_refused_or_wrong() -> None:
    ours = System("days", "none", "ps4_robust", "joint")
    matches = [_match("sand", 0.0), _match("sand", 0.0, known=False), _match("rock", 0.0)]
    outcomes = [Outcome(ours, Trial("sand", 0.0, m), _match("rock", 0.0)) for m in matches[:2]]
    outcomes += 2 * [Outcome(ours, Trial("sand", 0.0, matches[2]), matches[1])]
    assert answers_pct(outcomes) == (25.0, 25.0, 50.0, 50.0)


def test_names_are_escaped_on_the_page() -> None:
    shown = Exhibit(
        "orientation", ("textures",), [("<b>",)], values={"sharpness": "1", "best": "ps4"}
    )
    about = About(
        "reproduction", Path(output.__file__).with_name("chapter.html"), simulated=True, quick=True
    )
    html = page([(shown, b"")], {"textures": "a & b"}, about)
    assert "&lt;b&gt;" in html
    assert "a &amp; b" in html
    assert "Quick version" in html


# the command


def test_bad_input_is_one_line(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "empty").mkdir()
    out = tmp_path / "out"
    assert "no such folder" in refused("reproduce", "--out", out, "--materials", tmp_path / "no")
    line = refused("reproduce", "--out", out, "--materials", tmp_path / "empty")
    assert "at least two" in line
    assert not out.exists()
    assert "file: cannot be made" in refused("reproduce", "--quick", "--out", tmp_path / "file")


@pytest.mark.slow
def test_without_an_answering_scheduler_nothing_is_written(
    refused: Callable[..., str], tmp_path: Path
) -> None:
    line = refused(
        "reproduce", "--quick", "--out", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9"
    )
    assert "no Dask scheduler answers" in line
    assert list((tmp_path / "out").iterdir()) == []


# a small reproduction


def _cut(experiment: Experiment, names: tuple[str, ...], tests: int) -> Experiment:
    """All test runs with few textures and few tests."""
    runs = []
    for run in experiment.tests:
        textures = tuple(t for t in run.training.textures if t.name in names)
        runs.append(replace(run, training=replace(run.training, textures=textures)))
    orientations_deg = experiment.orientations_deg
    kept_deg = orientations_deg[:: len(orientations_deg) // tests][:tests]
    return replace(experiment, tests=tuple(runs), orientations_deg=kept_deg)


def _small_plan() -> Plan:
    plan = plan_of(True, material_textures(None))
    synthetic = ("rock", "malv_near", "domes", "cobbles", *EQUAL_SPECTRUM_TWINS)
    return replace(
        plan,
        slants=_cut(plan.slants, SYNTHETIC_TEXTURES[:4], 4),
        thirty=_cut(plan.thirty, ("rock", "ogil_long", "marble", "Bark014"), 3),
        synthetic=_cut(plan.synthetic, synthetic, 3),
        materials=_cut(plan.materials, ("Bark014", "Leather037", "Tiles036"), 3),
        robustness=_cut(plan.robustness, ("rock", "rock_smooth", "peel"), 3),
        days=_cut(plan.days, ("Bark014", "Leather037", "Tiles036"), 3),
        small_frames=_cut(plan.small_frames, ("Bark014", "Leather037", "Tiles036"), 3),
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
    expected = {f"{key}.{ending}" for key in keys for ending in ("csv", "png")}
    files = {path.name for path in reproduction.iterdir()}
    assert files == expected | {"reproduction.html", "results.json"}
    for key in keys:
        assert (reproduction / f"{key}.png").read_bytes().startswith(b"\x89PNG")
        assert _csv(reproduction, key)
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
