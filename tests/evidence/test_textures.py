"""`python -m tests.evidence.textures`: plan, faults, counts, and a small study with all files."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.chapter.plan import Conditions, PatchPosition, Texture
from capture.chapter.runs import CachedPatch, System, render_patch
from classify import Lighting, TextureLibrary, Trial
from classify.base.errors import InputError
from rig import EQUAL_SPECTRUM_TWINS, SYNTHETIC_30
from rig.scene.render import render_scene
from rig.scene.surfaces import PeriodicSurface, SurfacePatch
from tests.capture.chapter.test_chapter import cut, match_of
from tests.evidence.textures.faults import Faults, led_distance_for
from tests.evidence.textures.materials import material_textures
from tests.evidence.textures.open_set import Outcome, answers_pct, without_class
from tests.evidence.textures.plan import TexturePlan, texture_plan
from tests.evidence.textures.rejection import accepted_pct, rejection_curve
from tests.evidence.textures.results import TextureResults
from tests.evidence.textures.run import reproduce_textures
from tests.html_page import self_contained

SAND = PatchPosition(Texture("sand"), seed=3, shift_tiles=(0.0, 0.0), rotate_deg=20.0)
KEYS = {
    "classifiers_synthetic", "classifiers_twins_and_small", "materials", "orientation",
    "robustness", "unknown", "unknown_curves", "days", "open_set",
}  # fmt: skip


def test_the_full_plan_has_all_textures_sizes_and_numbers_of_sets() -> None:
    plan = texture_plan(False, material_textures(None))
    tests = {test.name: test for test in plan.synthetic.tests}
    assert {t.name for t in tests["slant 50"].training.textures} == set(SYNTHETIC_30)
    twins = {t.name for t in tests["slant 50, twins"].training.textures}
    assert twins == set(SYNTHETIC_30) | set(EQUAL_SPECTRUM_TWINS)
    assert tests["slant 50, small"].conditions.size_px == 128
    assert {test.conditions.size_px for test in plan.materials.tests} == {128, 256, 320}
    assert plan.robustness.frame_px == 512
    sand = Texture("sand")
    for experiment in (plan.days, plan.small_frames):
        assert {len(run.positions(sand)) for run in experiment.training} == {1, 3}
        for run in experiment.training:
            patches = {position.shift_tiles for position in run.positions(sand)}
            assert len(patches) == len(run.places)
            assert not patches & set(experiment.tested_places)


def test_folders_without_materials_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        material_textures(tmp_path / "none")
    with pytest.raises(InputError, match="at least two"):
        material_textures(tmp_path)


@pytest.mark.parametrize("rotate_deg", [0.0, 30.0, 45.0])
def test_small_frames_share_no_pixel_and_contain_no_seam(rotate_deg: float) -> None:
    experiment = texture_plan(False, material_textures(None)).small_frames
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


def test_every_set_draws_its_own_faults_within_the_bounds() -> None:
    usual = Conditions(45.0, 64)

    def mean_levels(position: PatchPosition, faults: Faults | None = None) -> np.ndarray:
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
    matches = [match_of("sand", 0.0), match_of("sand", 0.0, known=False), match_of("rock", 0.0)]
    outcomes = [Outcome(ours, Trial("sand", 0.0, m), match_of("rock", 0.0)) for m in matches[:2]]
    outcomes += 2 * [Outcome(ours, Trial("sand", 0.0, matches[2]), matches[1])]
    assert answers_pct(outcomes) == (25.0, 25.0, 50.0, 50.0)


def test_orientation_errors_are_modulo_180_and_of_textures_with_a_direction() -> None:
    ours = System("e", "x", "ps4", "joint")
    trials = [
        Trial("sand", 179.0, match_of("sand", 1.0)),
        Trial("sand", 20.0, match_of("sand", 21.0)),
        Trial("sand", 20.0, match_of("rock", 70.0)),
        Trial("sand", 20.0, match_of("sand", 60.0, sharpness=0.2)),
        Trial("rock", 5.0, match_of("rock", 5.0, known=False)),
    ]
    plan = texture_plan(True, material_textures(None))
    results = TextureResults(plan, {ours: [Outcome(ours, trial, None) for trial in trials]})
    assert results.orientation_errors_deg(ours) == pytest.approx([2.0, 1.0, 0.0])


def _small_plan() -> TexturePlan:
    plan = texture_plan(True, material_textures(None))
    synthetic = ("rock", "malv_near", "domes", "cobbles", *EQUAL_SPECTRUM_TWINS)
    materials = ("Bark014", "Leather037", "Tiles036")
    return replace(
        plan,
        thirty=cut(plan.thirty, ("rock", "ogil_long", "marble", "Bark014"), 3),
        synthetic=cut(plan.synthetic, synthetic, 3),
        materials=cut(plan.materials, materials, 3),
        robustness=cut(plan.robustness, ("rock", "rock_smooth", "peel"), 3),
        days=cut(plan.days, materials, 3),
        small_frames=cut(plan.small_frames, materials, 3),
    )


@pytest.mark.slow
def test_every_table_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    assert reproduce_textures(_small_plan(), folder) == folder / "textures.html"
    numbers = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert numbers["simulated"] is True
    assert set(numbers["exhibits"]) == KEYS
    for key in KEYS:
        with (folder / f"{key}.csv").open(encoding="utf-8", newline="") as file:
            assert list(csv.DictReader(file))
    assert {path.stem for path in folder.glob("*.png")} == {
        "classifiers_synthetic",
        "unknown_curves",
    }
    assert "$" not in self_contained(folder / "textures.html")


@settings(deadline=None, max_examples=20)
@given(st.floats(0.01, 0.5), st.floats(15.0, 70.0))
def test_the_led_distance_gives_the_fall_off_across_the_frame(
    fall_off: float, slant_deg: float
) -> None:
    distance_px = led_distance_for(fall_off, slant_deg, 40)
    flat = np.zeros((41, 41), np.float32)
    patch = SurfacePatch(flat, flat, flat, flat + np.float32(0.6))
    scene = render_scene(patch, Lighting.ring(slant_deg), led_distance_px=distance_px)
    for light, (far, near) in enumerate([((20, 0), (20, 40)), ((40, 20), (0, 20))]):
        shares = scene.lights[light][far] / scene.lights[light][near]
        assert 1.0 - shares == pytest.approx(fall_off, rel=1e-3)
