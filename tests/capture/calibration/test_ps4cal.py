"""The ``.ps4cal`` file: written calibrations are read back, edited and cut ones refused."""

import json
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from capture.base.errors import CalibrationError
from capture.calibration.ps4cal import CalibrationFile, PartRecord, flattened, rebuilt
from capture.calibration.setting import PART_NAMES
from classify import InputError, Lighting, SensorNoise
from classify.calibration.calibration import CalibratedLights, Calibration, Response, Scale
from classify.calibration.dark import Dark
from classify.calibration.photon_transfer import Noise
from classify.lights.flat_field import FlatField
from tests.archives import members, npy, write_members
from tests.capture.calibration.test_lookup import SETTING

RING = Lighting.ring(45.0)
RECORD = PartRecord(setting=SETTING, quality="gut: 0,3 %", figures={"x": 1.0}, source=("captured",))
COEFFICIENTS = np.random.default_rng(1).normal(0.0, 0.1, (4, 5, 5))
EXAMPLE = Calibration(
    dark=Dark(3.5, 0.7, np.array([[1, 2], [30, 4]], np.int32), None, 4095.0),
    response=Response(np.linspace(0.0, 1.0, 257) ** 2.2, 0.01, linear=False),
    noise=Noise(SensorNoise(2.5, 3.0, 1.0), 0.02),
    flat_field=FlatField(COEFFICIENTS, np.tile([-0.5, 0.5], (4, 1))),
    lights=CalibratedLights(RING, "plate", np.full(4, 0.2), None, 0.01, 1.2),
    scale=Scale(0.05, 0.001, np.eye(3), None, 0.1),
)


def example() -> CalibrationFile:
    return CalibrationFile(EXAMPLE, dict.fromkeys(PART_NAMES, RECORD))


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "rig.ps4cal"
    example().write(path)
    return path


def edited(path: Path, edit: Callable[[dict[str, Any]], object]) -> Path:
    """The same file with its header changed by `edit`."""
    content = members(path)
    header = json.loads(content["calibration.json"])
    edit(header)
    write_members(path, content | {"calibration.json": json.dumps(header).encode()})
    return path


def assert_refused(path: Path, cause: str = ".") -> None:
    with pytest.raises(CalibrationError, match=cause) as caught:
        CalibrationFile.read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def assert_same(ours: Any, theirs: Any) -> None:
    assert type(ours) is type(theirs)
    if is_dataclass(ours):
        for field in fields(ours):
            assert_same(getattr(ours, field.name), getattr(theirs, field.name))
    elif isinstance(ours, np.ndarray):
        np.testing.assert_allclose(ours, theirs, rtol=1e-15, strict=True)
    else:
        assert ours == theirs


def test_a_calibration_is_read_as_it_was_written(saved: Path) -> None:
    read = CalibrationFile.read(saved)
    assert_same(read.calibration, EXAMPLE)
    assert read.hash == example().hash == CalibrationFile.read(str(saved)).hash
    assert read.records == example().records
    assert read.records["dark"].setting == SETTING


def test_a_part_is_added_or_replaced_and_the_others_stay(saved: Path) -> None:
    file = CalibrationFile.read(saved)
    scale = Scale(0.1, 0.002, np.eye(3), np.zeros(5), 0.3)
    changed = file.with_part("scale", scale, RECORD)
    changed.write(saved)
    read = CalibrationFile.read(saved)
    assert read.hash == changed.hash != file.hash
    assert_same(read.calibration.scale, scale)
    assert_same(read.calibration.lights, EXAMPLE.lights)
    alone = CalibrationFile().with_part("scale", scale, RECORD)
    alone.write(saved)
    assert CalibrationFile.read(saved).calibration.dark is None


def test_a_sheet_measured_before_the_response_is_warned_of() -> None:
    later = RECORD.model_copy(update={"date": "2999-01-01T00:00:00+00:00"})
    changed = example().with_part("response", EXAMPLE.response, later)
    (warning,) = changed.warnings()
    assert warning.startswith("flat field and lights ")
    linear = Response(np.linspace(0.0, 1.0, 257), 0.0, linear=True)
    assert changed.with_part("response", linear, later).warnings() == []
    again = changed.with_part("flat_field", EXAMPLE.flat_field, later)
    assert again.with_part("lights", EXAMPLE.lights, later).warnings() == []


@settings(max_examples=40)
@given(
    intensities=st.none() | st.lists(st.floats(0.1, 10.0), min_size=3, max_size=3),
    offset=st.floats(0.0, 254.0),
    ambient=st.none() | st.floats(-1.0, 9.0),
    hot=st.lists(st.tuples(st.integers(0, 999), st.integers(0, 999)), max_size=5),
)
def test_any_part_is_the_same_after_it_was_taken_apart(intensities, offset, ambient, hot) -> None:
    ring = Lighting.ring(40.0, (0, 100, 200))
    lighting = Lighting(ring.directions, [] if intensities is None else intensities)
    lights = CalibratedLights(lighting, "list", np.zeros(3), np.ones(3), 0.0, None)
    assert_same(rebuilt("lights", *flattened(lights)), lights)
    dark = Dark(offset, 1.0, np.array(hot, np.int32).reshape(-1, 2), ambient, 255.0)
    assert_same(rebuilt("dark", *flattened(dark)), dark)


@pytest.mark.parametrize(
    ("edit", "cause"),
    [
        (lambda h: h.update(version=1), "version 1; .* 3; calibrate again"),
        (lambda h: h["parts"].pop("dark"), "match its SHA-256"),
        (lambda h: h["parts"].update(colour=h["parts"]["dark"]), "header field parts.colour"),
        (lambda h: h.pop("sha256"), "match its SHA-256"),
    ],
)
def test_an_edited_header_is_refused(saved: Path, edit: Any, cause: str) -> None:
    assert_refused(edited(saved, edit), cause)


def leaves(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all numbers, texts and nulls of a JSON value."""
    if isinstance(value, dict | list):
        keys = value if isinstance(value, dict) else range(len(value))
        return [leaf for key in keys for leaf in leaves(value[key], (*path, key))]
    return [path]


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_value_of_the_header_can_be_edited(saved: Path, data: st.DataObject) -> None:
    example().write(saved)
    header = json.loads(members(saved)["calibration.json"])
    *path, last = data.draw(st.sampled_from(leaves(header)))
    other = data.draw(st.none() | st.booleans() | st.integers(-9, 9) | st.floats(-9, 9) | st.text())

    def edit(changed: dict[str, Any]) -> None:
        place: Any = changed
        for key in path:
            place = place[key]
        assume(place[last] != other)
        place[last] = other

    assert_refused(edited(saved, edit))


def test_an_edited_array_is_refused(saved: Path) -> None:
    name = "flat_field/coefficients.npy"
    write_members(saved, members(saved) | {name: npy(1.001 * COEFFICIENTS)})
    assert_refused(saved, "does not match its SHA-256")
    without = {key: data for key, data in members(saved).items() if key != name}
    write_members(saved, without)
    assert_refused(saved, "holds no flat_field/coefficients.npy")


@pytest.mark.parametrize(
    ("name", "changes", "cause"),
    [
        ("noise", {"sensor.gain_e_per_dn": "x"}, "field sensor.gain_e_per_dn: .* number"),
        ("noise", {"sensor": None}, "field sensor.* has the wrong type"),
        ("dark", {"offset": float("nan")}, "field offset: .* finite"),
        ("dark", {"longer." * 21 + "offset": 1.0}, "nested more than 20 times"),
        ("dark", {"hot_pixels": 3}, "field hot_pixels: .* ndarray"),
        ("lights", {"source": "guess"}, "field source: .* 'plate'"),
        ("scale", {"more": 1.0}, "field more: Unexpected"),
    ],
)
def test_a_wrong_field_of_a_part_is_named(name: Any, changes: dict[str, Any], cause: str) -> None:
    values, arrays = flattened(getattr(EXAMPLE, name))
    arrays = {path: array for path, array in arrays.items() if path not in changes}
    with pytest.raises(InputError, match=cause):
        rebuilt(name, changes | values | changes, arrays)


def test_a_missing_field_of_a_part_is_named() -> None:
    values, arrays = flattened(EXAMPLE.noise)
    del values["sensor.read_noise_dn"]
    with pytest.raises(InputError, match=r"field sensor\.read_noise_dn: Field required"):
        rebuilt("noise", values, arrays)


@pytest.mark.parametrize(
    ("shape", "bounds", "cause"),
    [
        ((4, 8, 8), (4, 2), "T at most 7"),
        ((4, 5, 4), (4, 2), "give .lights, T, T."),
        ((4, 5), (4, 2), "give .lights, T, T."),
        ((), (4, 2), "give .lights, T, T."),
        ((4, 5, 5), (3, 2), "with .3, 2. bounds"),
        ((4, 5, 5), (4, 2), "bounds beyond 80"),
    ],
)
def test_a_flat_field_of_another_shape_is_refused(
    shape: tuple[int, ...], bounds: tuple[int, ...], cause: str
) -> None:
    arrays = {"coefficients": np.zeros(shape), "bounds": np.full(bounds, 81.0)}
    with pytest.raises(InputError, match=cause):
        rebuilt("flat_field", {}, arrays)


def test_no_file_and_another_suffix_say_what_to_do(tmp_path: Path) -> None:
    assert_refused(tmp_path / "none.ps4cal", "no such calibration; make one with ps4rig calibrate")
    with pytest.raises(InputError, match=r"end in \.ps4cal"):
        example().write(tmp_path / "rig.zip")
