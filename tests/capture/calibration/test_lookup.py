"""Where a set finds its calibration, and when the calibration is refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture import CapturedSet, capture_set
from capture.base.errors import CalibrationError
from capture.calibration.lookup import FoundCalibration, check_setting, keep_beside
from capture.calibration.ps4cal import CalibrationFile, PartRecord
from capture.calibration.setting import PART_NAMES, Setting
from capture.sets.captured_set import LoadedSet, calibration_of
from classify import Lighting
from classify.calibration.calibration import CalibratedLights, Scale
from classify.calibration.dark import Dark
from rig import Rig

SHAPE = (24, 32)
SETTING = Setting(
    simulated=False,
    rig_name="left",
    camera="v4l2 Camera",
    width_px=32,
    height_px=24,
    bit_depth=12,
    exposure_ms=8.0,
    gain=4.0,
    gamma=100.0,
    pixel_value_controls={"brightness": 128.0},
    light_directions=tuple(map(tuple, Lighting.ring(45.0).directions.tolist())),
    led_levels_percent=(100, 100, 100, 100),
)


def file_of(setting: Setting, mm_per_px: float = 0.1, date: str = "2026-01-01") -> CalibrationFile:
    scale = Scale(mm_per_px, 0.001, np.eye(3), None, 0.1)
    record = PartRecord(setting=setting, quality="Good.", source=("captured",), date=date)
    return CalibrationFile().with_part("scale", scale, record)


@pytest.fixture
def placed(made_set: Callable[..., CapturedSet]) -> CapturedSet:
    images = np.random.default_rng(1).integers(100, 60_000, (4, *SHAPE), np.uint16)
    return made_set(images, images[0])


def find(path: Path, captured: CapturedSet, **options: Any):
    return calibration_of(path, captured.metadata, captured.images.shape[1:], **options)


@pytest.mark.parametrize("folder", [".", "calibration", "../calibration"])
def test_a_named_calibration_is_found_beside_the_set(
    tmp_path: Path, placed: CapturedSet, folder: str
) -> None:
    file = file_of(placed.setting)
    sets = tmp_path / "sets"
    (sets / folder).mkdir(parents=True, exist_ok=True)
    path = sets / "a.ome.tif"
    assert find(path, placed) is None
    named = placed.with_calibration(file)
    file_of(SETTING).write(sets / folder / "another.ps4cal")
    file.write(sets / folder / "rig.ps4cal")
    found = find(path, named)
    assert found.path.samefile(sets / folder / "rig.ps4cal")
    assert found.file.hash == file.hash
    assert found.warnings == ()


def test_a_calibration_that_was_read_keeps_its_hash_in_the_copy(
    tmp_path: Path, placed: CapturedSet
) -> None:
    """Directions that are normalised again when they are read may change in the last bit."""
    source, path = tmp_path / "rig.ps4cal", tmp_path / "sets" / "a.ome.tif"
    record = file_of(placed.setting).records["scale"]
    rng = np.random.default_rng(5)
    for _ in range(20):
        lighting = Lighting(rng.uniform((-1, -1, 0.5), (1, 1, 1), (4, 3)))
        lights = CalibratedLights(lighting, "mirror sphere", np.full(4, 0.3), None, 0.01, None)
        CalibrationFile().with_part("lights", lights, record).write(source)
        read = CalibrationFile.read(source)
        keep_beside(read, path)
        found = find(path, placed.with_calibration(read))
        assert found.path == path.parent / "calibration" / f"rig-{read.hash[:8]}.ps4cal"


def test_a_missing_calibration_is_an_error_that_names_what_is_there(
    tmp_path: Path, placed: CapturedSet
) -> None:
    file = file_of(placed.setting)
    path, named = tmp_path / "a.ome.tif", placed.with_calibration(file)
    with pytest.raises(CalibrationError, match=rf"{file.hash[:8]}, which is neither beside") as no:
        find(path, named)
    assert "or give --calibration CAL" in str(no.value)
    changed = file.with_part("scale", file.calibration.scale, file_of(SETTING).records["scale"])
    changed.write(tmp_path / "rig.ps4cal")
    (tmp_path / "torn.ps4cal").write_bytes((tmp_path / "rig.ps4cal").read_bytes()[:100])
    with pytest.raises(CalibrationError, match=rf"rig.ps4cal is {changed.hash[:8]}") as others:
        find(path, named)
    assert "torn.ps4cal: not a readable" in str(others.value)


def test_a_given_calibration_is_used_instead_of_the_named_one(
    tmp_path: Path, placed: CapturedSet
) -> None:
    setting = placed.setting
    file_of(setting, 0.2).write(tmp_path / "new.ps4cal")
    path, named = tmp_path / "a.ome.tif", placed.with_calibration(file_of(setting))
    found = find(path, named, chosen=tmp_path / "new.ps4cal")
    assert found.file.calibration.scale.mm_per_px == 0.2
    file_of(SETTING.model_copy(update={"width_px": 64})).write(tmp_path / "other.ps4cal")
    with pytest.raises(CalibrationError, match=r"other\.ps4cal: .*a\.ome\.tif"):
        find(path, named, chosen=tmp_path / "other.ps4cal")


@pytest.mark.parametrize(("days", "warned"), [(300, False), (365 + 31, True)])
def test_an_old_calibration_is_used_with_a_warning(
    tmp_path: Path, placed: CapturedSet, days: int, warned: bool
) -> None:
    date = str(np.datetime64(placed.metadata.created_utc[:10]) - np.timedelta64(days, "D"))
    file = file_of(placed.setting, date=date)
    file.write(tmp_path / "rig.ps4cal")
    found = find(tmp_path / "a.ome.tif", placed.with_calibration(file))
    said = (f"the calibration (scale) was measured {days} days before",) if warned else ()
    assert [text[: len(said[0])] for text in found.warnings] == list(said)


def test_photographs_are_as_old_as_their_files_state(tmp_path: Path, placed: CapturedSet) -> None:
    file = file_of(placed.setting, date="2020-05-01")
    file.write(tmp_path / "rig.ps4cal")
    images = tuple(
        image.model_copy(update={"source_file": "a.png"}) for image in placed.metadata.images
    )
    imported = {"images": images, "photographed": "2020-05-02T10:00:00"}
    metadata = placed.with_calibration(file).metadata.model_copy(update=imported)
    assert find(tmp_path / "a.ome.tif", replace(placed, metadata=metadata)).warnings == ()


def test_the_copy_beside_a_set_outlives_a_change_of_the_file(
    tmp_path: Path, placed: CapturedSet
) -> None:
    (tmp_path / "sets").mkdir()
    source, path = tmp_path / "rig.ps4cal", tmp_path / "sets" / "a.ome.tif"
    file = file_of(placed.setting)
    file.write(source)
    for _ in range(2):
        keep_beside(CalibrationFile.read(source), path)
    file_of(placed.setting, 0.3).write(source)
    (copy,) = (tmp_path / "sets" / "calibration").iterdir()
    assert copy.name == f"rig-{file.hash[:8]}.ps4cal"
    assert find(path, placed.with_calibration(file)).path == copy
    session = tmp_path / "calibration"
    session.mkdir()
    keep_beside(CalibrationFile.read(copy), tmp_path / "sets" / "b.ome.tif")
    assert len(list(session.iterdir())) == 1


@pytest.mark.parametrize(
    ("change", "parts", "cause"),
    [
        ({"rig_name": "right"}, set(PART_NAMES), "rig 'right' instead"),
        ({"camera": "v4l2 B"}, set(PART_NAMES), "camera 'v4l2 B' instead"),
        ({"width_px": 64}, set(PART_NAMES), "64 x 24 px instead"),
        ({"crop": (1, 1, 32, 24)}, set(PART_NAMES), "crop (1, 1, 32, 24) instead of None"),
        ({"simulated": True}, set(PART_NAMES), "one is simulated"),
        ({"bit_depth": 8}, {"dark", "response", "noise"}, "8 bit instead of 12"),
        ({"gain": 9.0}, {"dark", "response", "noise"}, "gain 9 instead of 4"),
        ({"gamma": 90.0}, {"dark", "response", "noise"}, "gamma 90 instead of 100"),
        (
            {"pixel_value_controls": {"brightness": 100.0}},
            {"dark", "response", "noise"},
            "brightness 100 instead of 128",
        ),
        ({"photograph_gamma": "srgb"}, {"dark", "response", "noise"}, "srgb instead of linear"),
        ({"exposure_ms": 9.0}, {"dark"}, "exposure 9 ms instead"),
        ({"light_directions": SETTING.light_directions[:3]}, {"flat_field", "lights"}, "3 lights"),
        (
            {"light_directions": SETTING.light_directions[::-1]},
            {"flat_field", "lights"},
            "lights in another order",
        ),
        (
            {"led_levels_percent": (100, 100, 50, 100)},
            {"flat_field", "lights"},
            "100, 100, 50, 100 instead of 100, 100, 100, 100 %",
        ),
    ],
)
def test_a_part_is_refused_only_for_what_it_depends_on(
    change: dict[str, Any], parts: set[str], cause: str
) -> None:
    other = Setting.model_validate(SETTING.model_dump() | change)
    for part in PART_NAMES:
        assert bool(SETTING.differences(other, part)) == (part in parts)
        assert all(cause in each for each in SETTING.differences(other, part))
        assert SETTING.differences(SETTING, part) == []


@given(exposure_ms=st.floats(1e-3, 1e4), change=st.floats(-0.01, 0.01))
def test_rounding_of_an_exposure_and_unknown_values_are_no_difference(
    exposure_ms: float, change: float
) -> None:
    ours = SETTING.model_copy(update={"exposure_ms": exposure_ms})
    theirs = SETTING.model_copy(update={"exposure_ms": exposure_ms * (1.0 + change)})
    unknown = {"rig_name": None, "camera": None, "exposure_ms": None, "gain": None, "gamma": None}
    unknown |= {"pixel_value_controls": {}}
    photographs = SETTING.model_copy(update=unknown | {"led_levels_percent": (None,) * 4})
    for part in PART_NAMES:
        for other in (theirs, photographs):
            assert ours.differences(other, part) == []
            assert other.differences(ours, part) == []


def test_all_causes_are_named_with_their_parts() -> None:
    dark = Dark(0.0, 1.0, np.empty((0, 2), np.int32), None, 4095.0)
    file = file_of(SETTING).with_part("dark", dark, file_of(SETTING).records["scale"])
    other = SETTING.model_copy(update={"exposure_ms": 20.0, "rig_name": "right"})
    with pytest.raises(CalibrationError) as refused:
        check_setting(file, other, "this rig")
    assert "rig 'right' instead of 'left' (dark, scale); exposure 20 ms" in str(refused.value)


def test_the_setting_of_a_rig_and_of_photographs(placed: CapturedSet, rig: Rig) -> None:
    setting = Setting.of_rig(rig)
    assert setting.camera == "simulated simulated camera"
    assert (setting.width_px, setting.height_px, setting.bit_depth) == (64, 64, 12)
    assert setting.led_levels_percent == (100, 100, 100, 100)
    assert placed.setting.camera is None
    assert capture_set(rig).metadata.rig_name == setting.rig_name
    assert capture_set(rig).setting == setting


def test_a_scale_is_that_of_the_calibration_in_use_or_of_the_import(placed: CapturedSet) -> None:
    without_scale, own = CalibrationFile(), file_of(SETTING, 0.1)
    given = replace(placed, metadata=placed.metadata.model_copy(update={"mm_per_px": 0.05}))
    about = {"mm_per_px": 0.1, "calibration_ids": (own.hash,)}
    calibrated = replace(placed, metadata=placed.metadata.model_copy(update=about))

    def scale(captured: CapturedSet, file: CalibrationFile | None) -> float | None:
        found = None if file is None else FoundCalibration(Path("rig.ps4cal"), file, ())
        return LoadedSet(captured, found).mm_per_px

    assert [scale(given, file) for file in (None, without_scale, own)] == [0.05, 0.05, 0.1]
    assert [scale(calibrated, file) for file in (None, without_scale, own)] == [None, None, 0.1]
