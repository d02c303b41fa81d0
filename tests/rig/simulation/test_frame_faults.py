"""Frame faults and fault plans, as a program that reads the rig sees them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig import CameraError, ConfigError, Frame, Rig, RigConfig, load_config, open_rig


def rig_with(*faults: dict[str, Any]) -> Rig:
    camera = {"width_px": 48, "height_px": 32}
    return open_rig(
        RigConfig().with_changes(camera=camera, simulation={"faults": {"frames": faults}})
    )


def frames(count: int, *faults: dict[str, Any]) -> list[Frame]:
    with rig_with(*faults) as rig:
        rig.lights.select(0)
        return [rig.camera.read(1.0) for _ in range(count)]


@pytest.fixture(scope="module")
def good() -> list[Frame]:
    return frames(8)


@pytest.mark.parametrize(
    ("kind", "sequences"),
    [("dropped", [0, 1, 3, 4]), ("repeated_frame", [0, 1, 2, 2]), ("black", [0, 1, 2, 3])],
)
def test_frames_are_dropped_or_repeated_by_number(kind: str, sequences: list[int]) -> None:
    faulty = frames(4, {"kind": kind, "when": {"nth": 3}})
    assert [frame.sequence for frame in faulty] == sequences


@pytest.mark.parametrize("kind", ["dropped", "gone"])
def test_a_frame_that_is_not_delivered_is_not_repeated_either(kind: str) -> None:
    faults = [{"kind": name, "when": {"nth": 2}} for name in ("repeated_frame", kind)]
    with rig_with(*faults) as rig:
        assert rig.camera.read(1.0).sequence == 0
        if kind == "dropped":
            assert [rig.camera.read(1.0).sequence for _ in range(2)] == [2, 3]
        else:
            for _ in range(2):
                with pytest.raises(CameraError):
                    rig.camera.read(1.0)


def test_repeated_pixels_have_a_new_sequence_number(good: list[Frame]) -> None:
    faulty = frames(4, {"kind": "repeated_pixels", "when": {"nth": 3}})
    assert [frame.sequence for frame in faulty] == [0, 1, 2, 3]
    np.testing.assert_array_equal(faulty[2].pixels, good[1].pixels)
    np.testing.assert_array_equal(faulty[3].pixels, good[3].pixels)


def test_a_torn_frame_ends_with_rows_of_an_older_one(good: list[Frame]) -> None:
    torn = frames(5, {"kind": "torn", "row_share": 0.25, "frames_back": 2, "when": {"nth": 4}})[3]
    np.testing.assert_array_equal(torn.pixels[:8], good[3].pixels[:8])
    np.testing.assert_array_equal(torn.pixels[8:], good[1].pixels[8:])


def test_a_black_frame_is_zero_and_a_dark_one_has_noise() -> None:
    black, dark = (frames(1, {"kind": kind})[0].pixels for kind in ("black", "dark"))
    assert not black.any()
    assert dark.mean() == pytest.approx(4095 / 64, abs=0.5)
    assert dark.std() == pytest.approx(2.0, rel=0.1)


def test_a_late_stamp_is_shifted_and_a_late_frame_delayed(good: list[Frame]) -> None:
    late = frames(3, {"kind": "stamped_late", "delay_ms": 7.0, "when": {"nth": 2}})
    assert late[1].exposure_start_s == pytest.approx(good[1].exposure_start_s + 0.007)
    assert late[2].exposure_start_s == pytest.approx(good[2].exposure_start_s)
    assert frames(2, {"kind": "late", "delay_ms": 500.0})[1].sequence == 1


def test_a_drifting_exposure_grows_by_its_rate(good: list[Frame]) -> None:
    drifting = frames(8, {"kind": "drift", "rate_per_s": 0.6})
    black = 4095 / 64
    for frame, steady in zip(drifting, good, strict=True):
        gain = (frame.pixels.mean() - black) / (steady.pixels.mean() - black)
        assert gain == pytest.approx(1.0 + 0.6 * frame.exposure_start_s, rel=2e-3)


def test_a_camera_that_is_gone_stays_gone() -> None:
    with rig_with({"kind": "gone", "when": {"nth": 3}}) as rig:
        assert [rig.camera.read(1.0).sequence for _ in range(2)] == [0, 1]
        for _ in range(3):
            with pytest.raises(CameraError, match="the camera is gone"):
                rig.camera.read(1.0)


def test_a_fault_plan_is_a_file_or_part_of_rig_toml(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text('seed = 3\n[[leds]]\nkind = "dim"\nled = 2\nshare = 0.1\n')
    base = '[lights]\nport = "simulated"\n'
    (tmp_path / "named.toml").write_text(base + '[simulation]\nfaults = "plan.toml"\n')
    (tmp_path / "inline.toml").write_text(
        base + '[simulation]\nfaults = { seed = 3, leds = [{ kind="dim", led=2, share=0.1 }] }\n'
    )
    named, inline = (load_config(tmp_path / f"{name}.toml") for name in ("named", "inline"))
    assert named == inline
    assert named.simulation.faults is not None
    assert named.simulation.faults.leds[0].share == 0.1


@pytest.mark.parametrize(
    ("plan", "cause"),
    [
        ("[[lines]]\nkind = 'explode'\n", 'faults.lines.0.kind = "explode": '),
        ('[[lines]]\nkind = "lose"\nwen = 1\n', "simulation.faults.lines.0.wen = 1: "),
        ('[[leds]]\nkind = "dim"\nled = 9\n', "there is no LED 9"),
        ('[[leds]]\nkind = "swapped"\nled = 1\n', "other is the LED"),
        ('[[leds]]\nkind = "swapped"\nled = 1\nother = -1\n', "faults.leds.0.other = -1: "),
        ("[[frames]\n", "plan.toml: not valid TOML"),
        (None, "plan.toml: no such"),
    ],
)
def test_an_invalid_fault_plan_is_refused(tmp_path: Path, plan: str | None, cause: str) -> None:
    if plan is not None:
        (tmp_path / "plan.toml").write_text(plan)
    (tmp_path / "rig.toml").write_text(
        '[lights]\nport = "simulated"\n[simulation]\nfaults = "plan.toml"\n'
    )
    with pytest.raises(ConfigError) as caught:
        load_config(tmp_path / "rig.toml")
    assert cause in str(caught.value)
