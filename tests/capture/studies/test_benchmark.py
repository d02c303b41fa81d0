"""`ps4rig bench`: what it compares with, what it compares in, and what it says."""

import json
import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture.studies.benchmark import references, run, search, solvers
from capture.studies.benchmark.figures import Chapter, Figure, as_json, print_chapter
from capture.studies.benchmark.memory import memory_chapter, solve_step
from capture.studies.benchmark.pipeline import pipeline_chapter
from capture.studies.benchmark.references import Mixtures, Textures, observed_textures
from capture.studies.benchmark.scenes import mosaic, patch, turned_patch
from capture.studies.benchmark.search import Room, needed_room, save_large_library, search_chapter
from capture.studies.benchmark.solvers import (
    drop_darkest,
    normal_least_squares,
    read_four_write_three,
)
from capture.studies.benchmark.stopwatch import least_ms
from classify import Lighting, photometric_stereo

# Whole benchmarks, if short ones.
pytestmark = pytest.mark.slow

NAMES = ("rock", "sand", "malv", "ogil", "domes", "marble")
FRAME_PX = 128
SMALL_FRAME = (48, 70)


@pytest.fixture(scope="module")
def textures() -> Textures:
    return observed_textures(NAMES, FRAME_PX)


@pytest.fixture
def small_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "SMALLER", (8, 200, 1200))
    monkeypatch.setattr(search, "LARGE", 1600)
    monkeypatch.setattr(search, "_TIMED_QUERIES", 3)
    monkeypatch.setattr(search, "_RECALL_QUERIES", 20)
    monkeypatch.setattr(search, "_FEWER_QUERIES", 10)


def values(chapter: Chapter) -> dict[str, float]:
    return {f"{figure.step} {figure.unit}": figure.value for figure in chapter.figures}


@pytest.mark.parametrize(
    ("value", "bound", "met"),
    [
        (1.9, "at most", True),
        (2.0, "at most", True),
        (2.1, "at most", False),
        (1.9, "at least", False),
        (2.0, "at least", True),
    ],
)
def test_a_target_is_met_or_missed(value: float, bound: Any, met: bool) -> None:
    assert Figure("step", value, "x", target=2.0, bound=bound).met is met
    assert Figure("step", value, "x", bound=bound).met is None


def test_a_table_says_what_was_missed(capsys: pytest.CaptureFixture[str]) -> None:
    figures = [
        Figure("solve", 3.14159, "x floor", 12.3456, 2.0),
        Figure("recall", 99.95, "%", target=99.9, bound="at least"),
        Figure("plain", 12345.6, "ms"),
    ]
    print_chapter(Chapter("Title", figures, ("A note.",)))
    shown = capsys.readouterr().out
    rows = [line for line in shown.splitlines() if line.startswith("│")]
    assert "3.14 x floor" in rows[0]
    assert "at most 2, missed" in rows[0]
    assert "12.3 ms" in rows[0]
    assert "99.95 %" in rows[1]
    assert "missed" not in rows[1]
    assert "12346 ms" in rows[2]
    assert "A note." in shown


def test_json_is_plain_and_keeps_targets() -> None:
    chapter = Chapter("Title", [Figure("solve", 1 / 3, "x floor", 2 / 3, 2.0)], ("A note.",))
    assert json.loads(json.dumps(as_json(chapter))) == {
        "title": "Title",
        "notes": ["A note."],
        "figures": [
            {
                "step": "solve", "value": 0.333333, "unit": "x floor", "ms": 0.666667,
                "target": 2.0, "bound": "at most", "met": True,
            },
        ],
    }  # fmt: skip


def test_functions_take_turns_and_the_first_call_does_not_count() -> None:
    calls: list[str] = []
    clock: Iterator[float] = iter([9.0, 1.0, 3.0, 2.0, 5.0, 4.0])

    def work(name: str) -> None:
        calls.append(name)

    with pytest.MonkeyPatch.context() as patched:
        moments: list[float] = []
        for ms in clock:
            moments += [0.0, ms / 1e3]
        patched.setattr("time.perf_counter", iter(moments).__next__)
        found = least_ms({"a": partial(work, "a"), "b": partial(work, "b")}, rounds=3)
    assert calls == ["a", "b"] * 4
    assert found == {"a": pytest.approx(3.0), "b": pytest.approx(1.0)}


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_the_floor_reads_four_and_writes_three(kind: type) -> None:
    images = np.random.default_rng(0).integers(0, 255, (4, 5, 7)).astype(kind)
    three = np.full((3, 5, 7), np.nan, np.float32)
    read_four_write_three(images, *three)
    wide = images.astype(np.float32)
    np.testing.assert_array_equal(three[0], wide[0] - wide[2])
    np.testing.assert_array_equal(three[1], wide[1] - wide[3])
    np.testing.assert_array_equal(three[2], wide.sum(axis=0))


def test_numpy_finds_the_same_surface() -> None:
    shot = mosaic((40, 60), 16)
    p, q, albedo = drop_darkest(shot.images, shot.lighting)
    ps4 = photometric_stereo(shot.images, shot.lighting, "ps4")
    three_lit = ps4.valid & (np.sort(shot.images, axis=0)[0] < np.sort(shot.images, axis=0)[1])
    assert three_lit.mean() > 0.5
    for ours, theirs in ((ps4.p, p), (ps4.q, q), (ps4.albedo, albedo)):
        np.testing.assert_allclose(
            ours[three_lit], theirs.reshape(40, 60)[three_lit], rtol=2e-3, atol=1e-6
        )
    normals = normal_least_squares(shot.images, shot.lighting).reshape(3, 40, 60)
    all_lights = photometric_stereo(shot.images, shot.lighting, "least_squares")
    np.testing.assert_allclose(np.linalg.norm(normals, axis=0), all_lights.albedo, rtol=1e-4)


@pytest.mark.parametrize("bits", [8, 16])
def test_a_mosaic_is_as_large_and_deep_as_asked(bits: int) -> None:
    shot = mosaic((700, 2100), bits)
    assert shot.images.shape == (4, 700, 2100)
    assert shot.images.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert shot.images.flags.c_contiguous
    assert shot.ambient is None
    assert shot.full_scale == 2**bits - 1
    assert 0.2 < shot.images.mean() / shot.full_scale < 0.7
    assert shot.solve("ps4").valid.mean() > 0.9


def test_solvers_are_compared_with_floor_and_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solvers, "FRAME_PX", SMALL_FRAME)
    eight, sixteen = solvers.solver_chapters(quick=True)
    assert "8 bit" in eight.title
    assert "16 bit" in sixteen.title
    for chapter in (eight, sixteen):
        found = values(chapter)
        assert found["floor: read 4 planes, write 3 float32 x floor"] == 1.0
        assert all(math.isfinite(value) and value > 0 for value in found.values())
        for method in ("ps4", "ps4_robust", "least_squares"):
            assert f"{method} x floor" in found
            assert f"numpy lstsq x {method}" in found
        assert found["ps4 and every other map x floor"] > found["ps4 x floor"]
        targets = {
            f"{figure.step} {figure.unit}": figure.target
            for figure in chapter.figures
            if figure.target
        }
        assert targets == {"ps4 x floor": 2.0, "numpy lstsq x ps4": 100.0}


def test_every_stage_of_a_classification_is_measured(textures: Textures) -> None:
    chapter = pipeline_chapter(textures.library, FRAME_PX, quick=True)
    found = values(chapter)
    whole = found["whole, images to match ms"]
    stages = ("solve, ps4_robust", "fields", "spectra", "statistics", "signature", "match")
    per_megapixel = [found[f"{stage} ms per megapixel"] for stage in stages]
    assert sum(per_megapixel) * FRAME_PX**2 / 1e6 < 2.0 * whole
    assert "sand" in chapter.notes[-1]


def test_sets_of_a_class_are_found_in_a_library_of_mixtures(textures: Textures) -> None:
    mixtures = Mixtures(textures, 40)
    library = mixtures.library(160)
    assert len(library.classes) == 40
    assert library.signatures.shape == (160, textures.signatures.shape[-1])
    asked = np.arange(40)
    found = [library.match(signature).nearest for signature in mixtures.sets(asked)]
    right = [name == f"class {index}" for index, name in zip(asked, found, strict=True)]
    assert np.mean(right) > 0.7
    assert (library.signatures[:, -1] > 0.1).all()


def test_the_same_mixtures_come_again(textures: Textures) -> None:
    one, other = (Mixtures(textures, 9, seed=3).library(30) for _ in range(2))
    np.testing.assert_array_equal(one.signatures, other.signatures)


@pytest.mark.usefixtures("small_libraries")
def test_search_is_measured_at_every_size(textures: Textures, tmp_path: Path) -> None:
    mixtures, path = Mixtures(textures, 400), tmp_path / "large.ps4lib"
    save_large_library(mixtures, path)
    chapter = search_chapter(mixtures, path, quick=True)
    found = values(chapter)
    assert found["match, 8 references x that of 8"] == 1.0
    for size, queries in (("1,200", 10), ("1,600", 10)):
        assert found[f"sieve, {size} references, recall of {queries} queries %"] >= 99.0
        assert 0 < found[f"sieve, {size} references, compared at most references"] <= 1600
    targets = [figure.target for figure in chapter.figures if figure.target is not None]
    assert targets == [1000.0, 50.0, 50.0, 99.9, 99.9]
    without = values(search_chapter(mixtures, None, quick=True))
    assert not any("1,600" in step or "opening" in step for step in without)


def test_room_is_known_before_it_is_taken(textures: Textures, tmp_path: Path) -> None:
    room = needed_room(textures, tmp_path)
    assert room.disk > 100_000 * textures.signatures.shape[-1] * 4
    assert room.memory > room.disk
    assert room.free_memory > 0
    assert Room(disk=10, memory=10, free_disk=11, free_memory=11).enough
    assert not Room(disk=10, memory=10, free_disk=9, free_memory=11).enough
    assert not Room(disk=10, memory=10, free_disk=11, free_memory=9).enough
    assert "GB of disk" in str(room)


def test_peak_memory_is_what_a_step_takes() -> None:
    """A step that fills 80 MB, and a solver whose input does not count."""
    filled = partial(partial, np.ones, 10_000_000)
    shot = patch("sand", 0, 512)
    chapter = memory_chapter({"ones": filled, "solve": partial(solve_step, shot, "ps4")})
    ones, solve = (figure.value for figure in chapter.figures)
    assert ones == pytest.approx(80.0, abs=2.0)
    # p, q, albedo and validity; a little memory may be used again.
    maps = 512 * 512 * (3 * 4 + 1) / 1e6
    assert 0.9 * maps < solve < 4 * maps


def test_a_turned_patch_is_lit_like_the_rest() -> None:
    shot = turned_patch("sand", 3, 64, 33.0)
    assert shot.images.shape == (4, 64, 64)
    assert shot.ambient is not None
    assert shot.lighting == Lighting.ring(50.0)


@pytest.fixture
def small_bench(monkeypatch: pytest.MonkeyPatch, textures: Textures, tmp_path: Path) -> Path:
    """Everything small; returns the folder for temporary files."""
    monkeypatch.setattr(solvers, "FRAME_PX", SMALL_FRAME)
    monkeypatch.setattr(run, "FRAMES_PX", (FRAME_PX,))
    monkeypatch.setattr(run, "observed_textures", lambda: textures)
    monkeypatch.setattr(run, "memory_chapter", lambda steps: Chapter("Memory", [], tuple(steps)))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


@pytest.mark.usefixtures("small_libraries")
def test_the_command_measures_all_and_leaves_nothing_behind(
    small_bench: Path, ps4rig: Callable[..., Any]
) -> None:
    result = ps4rig("bench", "--json")
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)
    assert told["machine"]["cores"] >= 1
    titles = [chapter["title"] for chapter in told["chapters"]]
    assert len(titles) == 5
    assert "GB of disk" in result.stderr
    assert any("1,600" in note for note in told["chapters"][-1]["notes"])
    assert list(small_bench.iterdir()) == []


@pytest.mark.usefixtures("small_libraries")
def test_without_room_the_large_library_is_left_out(
    small_bench: Path, ps4rig: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "_available_bytes", lambda: 1)
    result = ps4rig("bench")
    assert result.exit_code == 0, result.stderr
    assert "left out" in result.stderr
    assert "1,200 references" in result.stdout
    assert "1,600 references" not in result.stdout
    assert list(small_bench.iterdir()) == []
    assert references.SETS_OF_A_CLASS == 4
