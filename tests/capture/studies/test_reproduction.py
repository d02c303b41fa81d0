"""`ps4rig reproduce`: plans, scenes and scores, and a small reproduction of the whole."""

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture.studies.reproduction import scenes
from capture.studies.reproduction.exams import Answer
from capture.studies.reproduction.exhibit import exhibit
from capture.studies.reproduction.experiments import material_textures, plan_of, thirty_textures
from capture.studies.reproduction.page import page
from capture.studies.reproduction.plan import Experiment, Plan
from capture.studies.reproduction.rejection import ScorePair
from capture.studies.reproduction.rejection_exhibits import accepted_at, rejection_curve
from capture.studies.reproduction.run import reproduce
from capture.studies.reproduction.scenes import (
    Conditions,
    Patch,
    Place,
    Texture,
    expose,
    render,
    solve,
)
from capture.studies.reproduction.shadow_counts import SHADOW_TILTS_DEG, ShadowTask, shadow_shares
from capture.studies.reproduction.tally import Tally
from rig import EQUAL_SPECTRUM_TWINS, SYNTHETIC_30, SYNTHETIC_TEXTURES
from rig.scene.material_folder import bundled_materials
from rig.scene.surfaces import PeriodicSurface

Rows = list[dict[str, str]]

SAND = Place(Texture("sand"), seed=3, elsewhere=False, rotate_deg=20.0)
FIGURES = ("01", "02", "03", "05", "07", "08", "09", "10", "11", "13")
TABLES = (
    "summary", "table_9_01", "classifiers_synthetic", "classifiers_twins_and_small", "materials",
    "orientation", "robustness", "unknown", "unknown_curves",
)  # fmt: skip


# the plan


@pytest.mark.parametrize("quick", [False, True])
def test_a_plan_asks_at_many_orientations_and_never_a_quarter_turn(quick: bool) -> None:
    plan = plan_of(quick, material_textures(None))
    for experiment in plan.experiments:
        turns = experiment.turns_deg
        assert len(set(turns)) == len(turns) >= 12
        assert all(0.0 < turn < 200.0 for turn in turns)
        assert min(abs((turn + 45.0) % 90.0 - 45.0) for turn in turns) > 1.0


def test_the_full_plan_has_the_textures_that_are_asked_for() -> None:
    plan = plan_of(False, material_textures(None))
    names = [texture.name for texture in thirty_textures(False)]
    assert len(set(names)) == len(names) == 30
    assert set(bundled_materials()) <= set(names)
    assert len(set(names) & set(SYNTHETIC_30)) == 22
    assert {texture.name for texture in plan.slants.textures} == set(SYNTHETIC_TEXTURES[:4])
    by_exam = {exam.name: exam for exam in plan.synthetic.exams}
    assert {t.name for t in by_exam["slant 50"].lesson.textures} == set(SYNTHETIC_30)
    twins = {t.name for t in by_exam["slant 50, twins"].lesson.textures}
    assert twins == set(SYNTHETIC_30) | set(EQUAL_SPECTRUM_TWINS)
    assert by_exam["slant 50, small"].conditions.size_px == 128
    sizes = {exam.conditions.size_px for exam in plan.materials.exams}
    assert sizes == {128, 256, 320}
    assert plan.robustness.frame_px == 512
    vz = [e.lesson for e in plan.thirty.exams if len(e.lesson.turns_deg) > 1]
    assert all(4 * len(lesson.turns_deg) == 28 for lesson in vz)


def test_disjoint_tests_are_other_realisations_and_other_places() -> None:
    experiment = plan_of(False, material_textures(None)).thirty
    sand, bark = Texture("sand"), Texture("Bark014", bundled_materials()["Bark014"])
    seeds = {experiment.test_place(sand, i, "disjoint").seed for i in range(24)}
    assert len(seeds) == 24
    assert experiment.learned_place(sand, 0.0).seed not in seeds
    assert experiment.test_place(sand, 5, "turned").seed == experiment.learned_place(sand, 0.0).seed
    assert experiment.test_place(bark, 5, "disjoint").elsewhere
    assert not experiment.test_place(bark, 5, "turned").elsewhere


@pytest.mark.parametrize("rotate_deg", [0.0, 30.0, 45.0])
def test_a_patch_elsewhere_shares_no_pixel_with_the_learned_one(
    monkeypatch: pytest.MonkeyPatch, rotate_deg: float
) -> None:
    tile = np.zeros((512, 512), np.float32)
    learned_part = np.full_like(tile, 0.2)
    learned_part[128:384, 128:384] = 1.0
    surface = PeriodicSurface(tile, tile, tile, learned_part, "marked")
    monkeypatch.setattr(scenes, "surface_of", lambda *_: surface)
    learned = Place(Texture("marked"), 0, elsewhere=False, rotate_deg=0.0)
    assert render(learned, 45.0, 256).albedo[2:-2, 2:-2].min() > 0.9
    other = render(replace(learned, elsewhere=True, rotate_deg=rotate_deg), 45.0, 256)
    # The squares touch at a corner.
    assert (other.albedo > 0.6).sum() <= 8


# scenes


def test_without_shadow_three_lights_see_the_truth() -> None:
    scene = render(SAND, 70.0, 128)
    assert scene.shadowed.mean() > 0.1
    shot = expose(scene, Conditions(70.0, 128, shadows=False), 1)
    assert float(np.min(shot.images)) < float(np.median(shot.ambient))  # negative light is kept
    surface = solve(shot, "ps3a")
    shadowed = solve(expose(scene, Conditions(70.0, 128), 1), "ps3a")
    error, shadow_error = (np.abs(each.p - scene.p).mean() for each in (surface, shadowed))
    assert error < 0.03
    assert shadow_error > 3.0 * error


def test_a_patch_makes_the_same_images_whenever_it_is_asked() -> None:
    conditions = Conditions(50.0, 64)
    first, second = (Patch(SAND, 128).shot(conditions).images for _ in range(2))
    np.testing.assert_array_equal(first, second)
    other = Patch(replace(SAND, rotate_deg=21.0), 128).shot(conditions).images
    assert not np.array_equal(first, other)


def test_smaller_frames_are_the_middle_of_larger_ones() -> None:
    patch = Patch(SAND, 128)
    large = solve(patch.shot(Conditions(40.0, 128)), "ps4").p[32:96, 32:96]
    small = solve(patch.shot(Conditions(40.0, 64)), "ps4").p
    assert np.abs(large - small).mean() < 0.03


def test_exposure_and_a_weak_led_show_in_the_images() -> None:
    patch = Patch(SAND, 64)
    usual, half, weak = (
        patch.shot(Conditions(40.0, 64, 16, **changed)).images.astype(float).mean(axis=(1, 2))
        for changed in ({}, {"exposure": 0.5}, {"weak_led": 0.95})
    )
    black = 1024.0
    np.testing.assert_allclose((half - black) / (usual - black), 0.5, atol=0.01)
    np.testing.assert_allclose((weak / usual)[[0, 2, 3]], 1.0, atol=0.005)
    assert 0.94 < weak[1] / usual[1] < 0.97


def test_the_shadow_count_of_sand_is_that_of_the_thesis_and_rises_with_slant() -> None:
    shares = [shadow_shares(ShadowTask(Texture("sand"), s, 512)) for s in (40.0, 60.0, 80.0)]
    at_0 = [100.0 * share[0] for share in shares]
    np.testing.assert_allclose(at_0, [1.0, 19.0, 61.0], atol=2.0)
    assert SHADOW_TILTS_DEG[-1] == 90.0
    assert all(share[0] > share[-1] for share in shares)


# counting


def _answer(nearest: str, turn_deg: float, found_deg: float, **changed: Any) -> Answer:
    answer = Answer(
        "e", "x", "disjoint", "ps4", "joint", "sand", turn_deg, nearest, found_deg, 0.9, False
    )
    return answer._replace(**changed)


def test_answers_are_counted_and_angles_compared_modulo_half_a_turn() -> None:
    tally = Tally(
        [
            _answer("sand", 179.0, 1.0),
            _answer("sand", 20.0, 21.0),
            _answer("rock", 20.0, 70.0),
            _answer("sand", 20.0, 60.0, sharpness=0.2),
            _answer("rock", 5.0, 5.0, texture="rock", rejected=True),
        ]
    )
    assert tally.count == 5
    assert tally.accuracy("e", "x", "ps4", "joint") == pytest.approx(80.0)
    assert tally.accuracy("e", "x", "ps4", "joint", texture="rock") == 100.0
    assert tally.rejected("e", "x", "ps4", "disjoint") == pytest.approx(20.0)
    errors = tally.orientation_errors_deg("e", "x", "ps4", "joint")
    assert errors == pytest.approx([2.0, 1.0, 0.0])
    assert tally.accuracy("e", "x", "ps3a", "joint") is None


def test_unknown_is_accepted_up_to_the_limit_that_keeps_the_known() -> None:
    pairs = [ScorePair(float(i), 50.0 + i) for i in range(100)]
    assert accepted_at(pairs, 0.0) == pytest.approx(0.50)
    assert accepted_at(pairs, 0.01) == pytest.approx(0.49)
    assert accepted_at(pairs, 0.6) == 0.0
    rejected, accepted = rejection_curve(pairs)
    assert rejected[0] == 0.0
    assert accepted[0] == pytest.approx(50.0)
    assert accepted[1] == pytest.approx(49.0)
    assert accepted == sorted(accepted, reverse=True)


def test_names_are_text_on_the_page() -> None:
    shown = exhibit("orientation", ("textures",), [("<b>",)], sharpness="1", best="ps4")
    html = page([(shown, b"")], {"textures": "a & b"}, quick=True)
    assert "&lt;b&gt;" in html
    assert "a &amp; b" in html
    assert "Quick version" in html


# the command


def test_what_cannot_be_done_is_one_line(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "empty").mkdir()
    out = tmp_path / "out"
    assert "no such folder" in refused("reproduce", "--out", out, "--materials", tmp_path / "no")
    line = refused("reproduce", "--out", out, "--materials", tmp_path / "empty")
    assert "at least two" in line
    assert not out.exists()
    assert "file: cannot be made" in refused("reproduce", "--quick", "--out", tmp_path / "file")


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_leaves_nothing(
    refused: Callable[..., str], tmp_path: Path
) -> None:
    line = refused(
        "reproduce", "--quick", "--out", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9"
    )
    assert "no Dask scheduler answers" in line
    assert list((tmp_path / "out").iterdir()) == []


def test_the_folder_for_the_page_must_be_given(ps4rig: Callable[..., Any]) -> None:
    result = ps4rig("reproduce", "--quick")
    assert result.exit_code == 2
    assert "Traceback" not in result.stderr


# the whole, small


def _cut(experiment: Experiment, names: tuple[str, ...], tests: int) -> Experiment:
    """Few textures, few tests; all exams."""
    exams = tuple(
        replace(
            exam,
            lesson=replace(
                exam.lesson,
                textures=tuple(t for t in exam.lesson.textures if t.name in names),
            ),
        )
        for exam in experiment.exams
    )
    turns_deg = experiment.turns_deg[:: len(experiment.turns_deg) // tests][:tests]
    return replace(experiment, exams=exams, turns_deg=turns_deg)


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
    )


@pytest.fixture(scope="module")
def reproduction(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reproduction") / "out"
    assert reproduce(_small_plan(), folder) == folder / "reproduction.html"
    return folder


def _csv(folder: Path, key: str) -> Rows:
    with (folder / f"{key}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


class _Targets(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.ids: set[str] = set()

    def handle_starttag(self, _tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("src", "href", "srcset", "data", "action", "poster"):
                self.targets.append(value or "")
            elif name == "id":
                self.ids.add(value or "")


@pytest.mark.slow
def test_every_figure_and_table_is_there(reproduction: Path) -> None:
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
def test_the_page_needs_nothing_beside_it(reproduction: Path) -> None:
    html = (reproduction / "reproduction.html").read_text(encoding="utf-8")
    links = _Targets()
    links.feed(html)
    assert "<b>Simulated.</b>" in html
    assert "Quick version" in html
    assert "$" not in re.sub(r"data:[^\"]*", "", html)
    assert all(target.startswith(("#", "data:")) for target in links.targets)
    assert {target[1:] for target in links.targets if target.startswith("#")} <= links.ids
    for number in ("90.56", "95.93", "99.07", "95.83"):
        assert number in html


@pytest.mark.slow
def test_four_lights_beat_three_in_shadow_and_nothing_falls_without(reproduction: Path) -> None:
    rows = [r for r in _csv(reproduction, "figure_9_01") if r["classifier"] == "polar_radial"]
    accuracy = {
        (row["shadow"], float(row["slant_deg"]), row["solver"]): float(row["accuracy_pct"])
        for row in rows
    }
    assert accuracy["with", 80.0, "ps4"] > accuracy["with", 80.0, "ps3a"]
    assert accuracy["with", 60.0, "ps4"] >= accuracy["with", 60.0, "ps3a"]
    assert accuracy["without", 80.0, "ps3a"] > accuracy["with", 80.0, "ps3a"]
    errors = {r["solver"]: float(r["rms_error_p"]) for r in _csv(reproduction, "figure_9_08")}
    assert errors["ps4"] < errors["ps3a"]


@pytest.mark.slow
def test_ours_is_no_worse_than_the_2d_spectra_on_disjoint_patches(reproduction: Path) -> None:
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
def test_a_table_has_the_thesis_s_numbers_beside_ours(reproduction: Path) -> None:
    rows = {row["system"]: row["thesis, %"] for row in _csv(reproduction, "summary")}
    assert rows["PS3, 1D"] == "90.56"
    assert rows["PS4, 2D"] == "99.07"
    costs = _csv(reproduction, "table_9_01")
    assert {row["training images a class"] for row in costs} == {"4", "28"}
    assert all(float(row["together, ms"]) > 0.0 for row in costs)
