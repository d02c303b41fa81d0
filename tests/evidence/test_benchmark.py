"""`python -m tests.evidence.benchmark`: its comparisons, its libraries, and its output."""

import json
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from capture.chapter.results import shortest_ms
from classify import Lighting, photometric_stereo
from tests.evidence.benchmark.measurements import Measurement, Section, as_json, print_section
from tests.evidence.benchmark.memory import memory_section, solve_step
from tests.evidence.benchmark.memory_floor import read_four_write_three
from tests.evidence.benchmark.mixtures import Mixtures, Textures, observed_textures
from tests.evidence.benchmark.pipeline import pipeline_section
from tests.evidence.benchmark.run import fits, print_benchmark
from tests.evidence.benchmark.scenes import mosaic, rotated_patch, texture_tile
from tests.evidence.benchmark.search import search_section
from tests.evidence.benchmark.settings import Settings
from tests.evidence.benchmark.solvers import drop_darkest, normal_least_squares, solver_sections

# Whole benchmarks, with small settings.
pytestmark = pytest.mark.slow

SMALL = Settings(
    solver_frame_px=(48, 70),
    frames_px=(128,),
    textures=("rock", "sand", "malv", "ogil", "domes", "marble"),
    texture_frame_px=128,
    library_sizes=(8, 200, 1200),
    largest_library=1600,
    solver_rounds=15,
    numpy_rounds=2,
    pipeline_rounds=20,
    match_rounds=1,
    match_queries=3,
    recall_queries=10,
    largest_recall_queries=10,
)


@pytest.fixture(scope="module")
def textures() -> Textures:
    return observed_textures(SMALL.textures, SMALL.texture_frame_px)


def values(section: Section) -> dict[str, float]:
    return {f"{each.step} {each.unit}": each.value for each in section.measurements}


@pytest.mark.parametrize(
    ("value", "at_most", "at_least"), [(1.9, True, False), (2.0, True, True), (2.1, False, True)]
)
def test_a_target_is_met_or_missed(value: float, at_most: bool, at_least: bool) -> None:
    assert Measurement("step", value, "x", target=2.0).met is at_most
    assert Measurement("step", value, "x", target=2.0, bound="at least").met is at_least
    assert Measurement("step", value, "x").met is None


def test_a_table_marks_missed_targets(capsys: pytest.CaptureFixture[str]) -> None:
    measurements = [
        Measurement("solve", 3.14159, "x floor", 12.3456, 2.0),
        Measurement("recall", 99.95, "%", target=99.9, bound="at least"),
        Measurement("plain", 12345.6, "ms"),
    ]
    print_section(Section("Title", measurements, ("A note.",)))
    shown = capsys.readouterr().out
    lines = shown.splitlines()
    rows = lines[next(number for number, line in enumerate(lines) if "──" in line) + 1 :]
    assert "3.14 x floor" in rows[0]
    assert "at most 2, missed" in rows[0]
    assert "12.3 ms" in rows[0]
    assert "99.95 %" in rows[1]
    assert "missed" not in rows[1]
    assert "12346 ms" in rows[2]
    assert "A note." in shown


def test_earlier_values_stand_before_the_measured_ones(capsys: pytest.CaptureFixture[str]) -> None:
    measurements = [Measurement("solve", 2.0, "ms"), Measurement("match", 1.0, "ms")]
    print_section(Section("Title", measurements), {"solve": 3.5})
    lines = capsys.readouterr().out.splitlines()
    assert ["solve", "3.5", "2", "ms"] in [line.split() for line in lines]
    assert ["match", "nan", "1", "ms"] in [line.split() for line in lines]


def test_json_has_plain_values_and_targets() -> None:
    section = Section("Title", [Measurement("solve", 1 / 3, "x floor", 2 / 3, 2.0)], ("A note.",))
    assert json.loads(json.dumps(as_json(section))) == {
        "title": "Title",
        "notes": ["A note."],
        "figures": [
            {
                "step": "solve", "value": 0.333333, "unit": "x floor", "ms": 0.666667,
                "target": 2.0, "bound": "at most", "met": True,
            },
        ],
    }  # fmt: skip


def test_each_round_calls_every_function_and_the_first_call_is_not_timed() -> None:
    calls: list[str] = []

    def moments() -> Iterator[float]:
        for ms in (9.0, 1.0, 3.0, 2.0, 5.0, 4.0):
            yield from (0.0, ms / 1e3)

    work = {name: partial(calls.append, name) for name in ("a", "b")}
    found = shortest_ms(work, rounds=3, clock_s=moments().__next__)
    assert calls == ["a", "b"] * 4
    assert found == {"a": pytest.approx(3.0), "b": pytest.approx(1.0)}


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_the_floor_reads_four_images_and_writes_three_maps(kind: type) -> None:
    images = np.random.default_rng(0).integers(0, 255, (4, 5, 7)).astype(kind)
    maps = np.full((3, 5, 7), np.nan, np.float32)
    read_four_write_three(images, maps)
    wide = images.astype(np.float32)
    np.testing.assert_array_equal(maps, [wide[0] - wide[2], wide[1] - wide[3], wide.sum(axis=0)])


def test_numpy_finds_the_same_surface() -> None:
    image_set = mosaic((40, 60), 16)
    p, q, albedo = drop_darkest(image_set.images, image_set.lighting)
    ps4 = photometric_stereo(image_set.images, image_set.lighting, "ps4")
    darkest, second = np.sort(image_set.images, axis=0)[:2]
    compared = ps4.valid & (darkest < second)
    assert compared.mean() > 0.5
    for ours, theirs in ((ps4.p, p), (ps4.q, q), (ps4.albedo, albedo)):
        np.testing.assert_allclose(
            ours[compared], theirs.reshape(40, 60)[compared], rtol=2e-3, atol=1e-6
        )
    normals = normal_least_squares(image_set.images, image_set.lighting).reshape(3, 40, 60)
    all_lights = photometric_stereo(image_set.images, image_set.lighting, "least_squares")
    np.testing.assert_allclose(np.linalg.norm(normals, axis=0), all_lights.albedo, rtol=1e-4)


@pytest.mark.parametrize("bits", [8, 16])
def test_a_mosaic_has_the_given_size_and_depth(bits: int) -> None:
    image_set = mosaic((700, 2100), bits)
    assert image_set.images.shape == (4, 700, 2100)
    assert image_set.images.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert image_set.images.flags.c_contiguous
    assert image_set.ambient is None
    assert image_set.full_scale == 2**bits - 1
    assert 0.2 < image_set.images.mean() / image_set.full_scale < 0.7
    assert image_set.solve("ps4").valid.mean() > 0.9


def test_solvers_are_compared_with_floor_and_numpy() -> None:
    for section, bits in zip(solver_sections(SMALL), ("8 bit", "16 bit"), strict=True):
        assert bits in section.title
        found = values(section)
        assert found["floor: read 4 planes, write 3 float32 x floor"] == 1.0
        assert all(math.isfinite(value) and value > 0 for value in found.values())
        for method in ("ps4", "ps4_robust", "least_squares"):
            assert f"{method} x floor" in found
            assert f"numpy lstsq x {method}" in found
        assert found["ps4 and every other map x floor"] > found["ps4 x floor"]
        targets = {f"{m.step} {m.unit}": m.target for m in section.measurements if m.target}
        near = {
            f"{method}, near x distant": 2.5 for method in ("ps4", "ps4_robust", "least_squares")
        }
        assert targets == {"ps4 x floor": 2.0, "numpy lstsq x ps4": 100.0} | near


def test_every_stage_of_a_classification_is_measured(textures: Textures) -> None:
    image_set = rotated_patch("sand", 3, 128, 33.0)
    assert image_set.ambient is not None
    assert image_set.lighting == Lighting.ring(50.0)
    section = pipeline_section(textures.library, 128, rounds=20)
    found = values(section)
    stages = ("solve, ps4_robust, planar", "fields", "spectra", "statistics", "signature", "match")
    assert sum(found[f"{stage} ms"] for stage in stages) < 2.0 * found["whole, images to match ms"]
    assert "sand" in section.notes[-1]


def test_a_library_of_mixtures_finds_sets_of_its_classes(
    textures: Textures,
) -> None:
    mixtures = Mixtures(textures, 40)
    library = mixtures.library(160)
    assert len(library.classes) == 40
    assert library.signatures.shape == (160, textures.signatures.shape[-1])
    classes = np.arange(40)
    nearest = [library.match(signature).nearest for signature in mixtures.sets(classes)]
    assert np.mean(np.array(nearest) == [f"class {index}" for index in classes]) > 0.7
    assert (library.signatures[:, -1] > 0.1).all()
    again = Mixtures(textures, 40).library(160)
    np.testing.assert_array_equal(again.signatures, library.signatures)


def test_search_is_measured_at_every_size(textures: Textures, tmp_path: Path) -> None:
    mixtures, path = Mixtures(textures, 400), tmp_path / "large.ps4lib"
    mixtures.library(1600).save(path)
    section = search_section(mixtures, path, SMALL)
    found = values(section)
    assert found["match, 8 references x that of 8"] == 1.0
    for size in ("1,200", "1,600"):
        assert found[f"sieve, {size} references, recall of 10 queries %"] >= 99.0
        assert 0 < found[f"sieve, {size} references, compared at most references"] <= 1600
    targets = [each.target for each in section.measurements if each.target is not None]
    assert targets == [1000.0, 50.0, 50.0, 99.9, 99.9]
    without = values(search_section(mixtures, None, SMALL))
    assert not any("1,600" in step or "opening" in step for step in without)


def test_a_library_needs_disk_and_memory(textures: Textures, tmp_path: Path) -> None:
    much, size = 10**12, 1000 * textures.signatures.shape[-1] * 4
    assert fits(1000, textures, tmp_path, free=(much, much))
    assert not fits(1000, textures, tmp_path, free=(size, much))
    assert not fits(1000, textures, tmp_path, free=(much, 2 * size))
    assert fits(1, textures, tmp_path)


def test_peak_memory_counts_what_a_step_allocates() -> None:
    filled = partial(partial, np.ones, 10_000_000)
    image_set = texture_tile("sand", 0, 512)
    section = memory_section({"ones": filled, "solve": partial(solve_step, image_set, "ps4")})
    ones, solve = (each.value for each in section.measurements)
    assert ones == pytest.approx(80.0, abs=2.0)
    # p, q, albedo and validity, but not the images; a little freed memory may be used again.
    maps = 512 * 512 * (3 * 4 + 1) / 1e6
    assert 0.9 * maps < solve < 4 * maps


@pytest.fixture
def temporary_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def test_a_benchmark_has_six_sections_and_removes_its_files(
    temporary_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    print_benchmark(SMALL, json=True)
    shown = capsys.readouterr()
    printed = json.loads(shown.out)
    assert printed["machine"]["cores"] >= 1
    assert printed["machine"]["threads"] >= 1
    assert printed["quick"] is False
    assert len(printed["chapters"]) == 6
    steps = [each["step"] for each in printed["chapters"][-1]["figures"]]
    assert "opening and match, 1,600 references" in steps
    assert "ps4_robust, 70 x 48, 16 bit" in steps
    assert "GB of disk" in shown.err
    assert list(temporary_folder.iterdir()) == []
