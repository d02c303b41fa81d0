"""The ``.ps4def`` file: written models are read back, damaged ones refused."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from classify import DefectModel, InputError, learn_defects
from classify.base.errors import DefectModelError
from tests.archives import members, npy, write_members

ARRAYS = ("gains", "octaves_centres", "good_scores", "false_alarm_rate")


@pytest.fixture(scope="module")
def model(stationary) -> DefectModel:
    parts = [stationary("dyed", seed=seed, side=256) for seed in range(3)]
    return learn_defects(parts, [0.0, None, 0.0])


@pytest.fixture
def saved(model, tmp_path: Path) -> Path:
    path = tmp_path / "defects.ps4def"
    model.save(path)
    return path


def put(path: Path, name: str, data: bytes) -> None:
    write_members(path, members(path) | {name: data})


def array_of(path: Path, name: str) -> np.ndarray:
    return np.load(io.BytesIO(members(path)[f"{name}.npy"]))


def assert_refused(path: Path, cause: str) -> None:
    with pytest.raises(DefectModelError, match=cause) as caught:
        DefectModel.load(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message


def test_a_saved_model_scores_like_the_one_that_was_learned(model, saved, stationary) -> None:
    loaded = DefectModel.load(saved)
    part = stationary("dyed", seed=9, side=256)
    assert loaded.sha256 == model.sha256
    assert loaded.false_alarm_rate == model.false_alarm_rate
    np.testing.assert_array_equal(loaded.good_scores, model.good_scores, strict=True)
    score = loaded.map_of(part, None).score
    np.testing.assert_array_equal(score, model.map_of(part, None).score)


@pytest.mark.parametrize("name", ARRAYS)
def test_a_changed_value_is_noticed(saved, name: str) -> None:
    changed = array_of(saved, name)
    changed.flat[0] += 0.5
    put(saved, f"{name}.npy", npy(changed))
    assert_refused(saved, "do not match their SHA-256")


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_of_other_shapes_or_with_nan_are_refused(saved, name: str) -> None:
    array = array_of(saved, name)
    put(saved, f"{name}.npy", npy(array[None]))
    assert_refused(saved, name)
    put(saved, f"{name}.npy", npy(np.full_like(array, np.nan)))
    assert_refused(saved, name)


@pytest.mark.parametrize(
    ("field", "value", "cause"),
    [
        ("version", 6, "use a newer ps4rig"),
        ("version", 4, "version 4; .* 5; teach it again"),
    ],
)
def test_other_headers_are_refused(saved, field: str, value: object, cause: str) -> None:
    header = json.loads(members(saved)["defects.json"]) | {field: value}
    put(saved, "defects.json", json.dumps(header).encode())
    assert_refused(saved, cause)


def test_a_limit_of_zero_is_refused(model, tmp_path: Path) -> None:
    path = tmp_path / "zero.ps4def"
    replace(model, limits=0.0 * model.limits).save(path)
    assert_refused(path, "not above 0")


def test_the_file_of_a_large_frame_has_at_most_200_kilobytes(stationary, tmp_path: Path) -> None:
    parts = [stationary("dyed", seed=seed, side=512) for seed in range(3)]
    learn_defects(parts, [0.0] * 3).save(tmp_path / "large.ps4def")
    assert (tmp_path / "large.ps4def").stat().st_size <= 200_000


def test_only_names_of_defect_models_are_written(model, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"end in \.ps4def"):
        model.save(tmp_path / "model.zip")
