"""Which new part of a calibration replaces the one that is there."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture.calibration.ps4cal import CalibrationFile, MeasuredPart, PartRecord
from capture.calibration.replacement import reason_to_keep
from capture.calibration.setting import PART_NAMES, PartName
from capture.commands.calibrate_flow import calibration_at, keep_parts
from classify import Lighting
from classify.base.errors import CalibrationRejected
from classify.calibration.calibration import CalibratedLights, Response, Scale
from classify.calibration.dark import Dark
from classify.calibration.photon_transfer import Noise
from classify.images import SensorNoise
from classify.lights.flat_field import FlatField
from tests.capture.calibration.test_lookup import SETTING

# Another setting on which each part depends.
CHANGES: dict[PartName, dict[str, Any]] = {
    "dark": {"gain": 9.0},
    "response": {"gain": 9.0},
    "noise": {"bit_depth": 8},
    "flat_field": {"led_levels_percent": (50,) * 4},
    "lights": {"width_px": 128},
    "scale": {"camera": "v4l2 B"},
}


def measured(name: PartName, part: Any, **figures: float) -> MeasuredPart:
    return MeasuredPart.now(name, part, SETTING, "Good.", figures, ("captured",))


def dark(offset: float = 60.0, noise: float = 2.0, frames: int = 16, ms: float = 8.0) -> Any:
    part = Dark(offset, noise, np.empty((0, 2), np.int32), None, 4095.0, ms)
    return measured("dark", part, frames=frames)


def response(power: float = 2.0, error: float = 0.001) -> Any:
    return measured("response", Response(np.linspace(0.0, 1.0, 257) ** power, error, False))


def noise(gain: float = 2.5, read: float = 2.0, error: float = 0.001) -> Any:
    return measured("noise", Noise(SensorNoise(gain, read, 0.0), 0.01), gain_error_share=error)


def flat_field(
    slope: float = 0.1, percent: float = 0.1, placements: int = 2, dimmer: float = 0.0
) -> Any:
    coefficients = np.zeros((4, 2, 2))
    coefficients[1, 0, 0] = -dimmer
    coefficients[:, 0, 1] = [slope, 0.1, 0.1, 0.1]
    part = FlatField(coefficients, np.tile([-1.0, 1.0], (4, 1)))
    return measured("flat_field", part, error_percent=percent, placements=placements)


def lights(
    slant: float = 45.0, deg: float = 0.3, px: float | None = 200.0, distance: float = 0.005
) -> Any:
    ring, near = Lighting.ring(slant), px is not None
    lighting = Lighting.near(px * ring.directions) if px is not None else ring
    errors = np.full(4, deg), np.full(4, distance) if near else None
    return measured("lights", CalibratedLights(lighting, "plate", *errors, 0.0, None))


def scale(mm_per_px: float = 0.12208, error: float = 0.0005, focal: float | None = None) -> Any:
    matrix = np.diag([1000.0, 1000.0, 1.0])
    return measured("scale", Scale(mm_per_px, error, matrix, None, 0.1, focal))


MAKERS: dict[PartName, Callable[..., Any]] = {
    "dark": dark, "response": response, "noise": noise, "flat_field": flat_field,
    "lights": lights, "scale": scale,
}  # fmt: skip


def file_with(*parts: MeasuredPart) -> CalibrationFile:
    file = CalibrationFile()
    for each in parts:
        file = file.with_part(each.name, each.part, each.record)
    return file


@pytest.mark.parametrize(
    ("new", "message"),
    [
        (scale(1.22, 0.001), r"1.22 mm .* 0.12208"),
        (scale(0.065, 0.005), r"0.065 mm .* 0.12208"),
        (scale(0.1240), "0.124 mm per px"),
        (lights(47.0), "light 0 in another direction"),
        (lights(60.0, px=None), "light 0 in another direction"),
        (lights(px=230.0, distance=0.01), "light 0 at 230 px .* 200"),
        (flat_field(0.3), "light 0 of another strength"),
        (flat_field(dimmer=0.3), r"light 1 .*strength \(35 %"),
        (response(2.2), "another curve"),
        (noise(3.0), "3 electrons .* 2.5"),
        (noise(2.5, 4.0), "read noise of 4"),
        (dark(90.0), "offset of 90"),
        (dark(noise=5.0), "noise of 5 instead"),
    ],
)
def test_a_part_that_contradicts_the_known_one_is_refused(
    tmp_path: Path, new: MeasuredPart, message: str
) -> None:
    path = tmp_path / "rig.ps4cal"
    file_with(MAKERS[new.name]()).write(path)
    before = path.read_bytes()
    with pytest.raises(CalibrationRejected, match=rf"rig.ps4cal: .*{message}.* --replace"):
        keep_parts(path, calibration_at(path), [new], json=False)
    assert path.read_bytes() == before
    kept = keep_parts(path, calibration_at(path), [new], replace=True, json=False)
    assert getattr(kept.calibration, new.name) is new.part


@pytest.mark.parametrize(
    ("new", "reason"),
    [
        (scale(0.1222, 0.005), "its error is 0.0005"),
        (scale(error=0.0007), "its error is"),
        (lights(distance=0.13), "its error is 0.0072"),
        (lights(deg=2.0), "its error is"),
        (lights(px=None), "it has positions"),
        (flat_field(percent=1.0), "its error is"),
        (flat_field(placements=1), "it has two placements"),
        (response(error=0.01), "its error is"),
        (noise(error=0.05), "its error is"),
        (dark(frames=2), "its error is"),
    ],
)
def test_a_worse_part_leaves_the_known_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], new: MeasuredPart, reason: str
) -> None:
    path = tmp_path / "rig.ps4cal"
    before = file_with(MAKERS[new.name]())
    before.write(path)
    kept = keep_parts(path, calibration_at(path), [new], json=False)
    assert kept.hash == before.hash == CalibrationFile.read(path).hash
    assert f"kept, because {reason}" in capsys.readouterr().out
    kept = keep_parts(path, calibration_at(path), [new], replace=True, json=False)
    assert getattr(kept.calibration, new.name) is new.part


@pytest.mark.parametrize("name", PART_NAMES)
def test_a_part_as_good_replaces_the_known_one(name: PartName) -> None:
    assert reason_to_keep(file_with(MAKERS[name]()), MAKERS[name]()) is None


@pytest.mark.parametrize(
    ("known", "new"),
    [
        (lights(px=None), lights(distance=0.13, deg=1.0)),
        (scale(error=0.01), scale(0.123, 0.001)),
        (scale(error=0.00001), scale(error=0.0004)),
        (flat_field(placements=1), flat_field()),
        (dark(frames=2), dark()),
    ],
)
def test_a_better_part_replaces_the_known_one(known: MeasuredPart, new: MeasuredPart) -> None:
    assert reason_to_keep(file_with(known), new) is None


def test_a_known_focal_length_is_kept() -> None:
    known = file_with(scale(focal=0.005))
    assert "focal length" in str(reason_to_keep(known, scale(error=0.0001)))


@pytest.mark.parametrize("name", PART_NAMES)
def test_a_part_of_another_setting_is_replaced(name: PartName) -> None:
    other = {
        "dark": dark(90.0), "response": response(2.2), "noise": noise(3.0), "lights": lights(50.0),
        "flat_field": flat_field(0.4), "scale": scale(1.22),
    }[name]  # fmt: skip
    setting = SETTING.model_copy(update=CHANGES[name])
    record = other.record.model_copy(update={"setting": setting})
    assert reason_to_keep(file_with(MAKERS[name]()), replace(other, record=record)) is None


def test_an_old_part_is_replaced_by_a_worse_one_but_not_contradicted() -> None:
    known = scale()
    record = known.record.model_copy(update={"date": "2020-01-01"})
    file = file_with(replace(known, record=record))
    assert reason_to_keep(file, scale(0.1222, 0.005)) is None
    with pytest.raises(CalibrationRejected, match="measured 2020-01-01"):
        reason_to_keep(file, scale(1.22))


def test_a_flat_field_from_before_a_curved_response_is_replaced() -> None:
    known = flat_field()
    record = known.record.model_copy(update={"date": "2026-01-01"})
    file = file_with(replace(known, record=record), response())
    assert reason_to_keep(file, flat_field(0.4)) is None


def test_another_dark_exposure_is_compared_with_none(tmp_path: Path) -> None:
    path = tmp_path / "rig.ps4cal"
    file_with(dark()).write(path)
    new = dark(90.0, frames=2, ms=20.0)
    record: PartRecord = new.record.model_copy(
        update={"setting": SETTING.model_copy(update={"exposure_ms": 20.0})}
    )
    kept = keep_parts(path, calibration_at(path), [replace(new, record=record)], json=False)
    assert kept.calibration.dark is not None
    assert kept.calibration.dark.exposures_ms == (8.0, 20.0)
    assert kept.calibration.dark.at(14.0).offset == pytest.approx(75.0)


def test_one_command_keeps_each_part_for_itself(tmp_path: Path) -> None:
    path = tmp_path / "rig.ps4cal"
    file_with(lights(), flat_field(percent=1.0)).write(path)
    new = [flat_field(), lights(distance=0.13)]
    kept = keep_parts(path, calibration_at(path), new, json=False)
    assert kept.calibration.flat_field is new[0].part
    assert kept.calibration.lights is not new[1].part
