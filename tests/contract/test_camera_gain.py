"""Every kind of camera states its gain, so that a calibration at another one is refused."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture import CapturedSet, capture_set
from capture.base.errors import CalibrationError
from capture.calibration.lookup import check_setting
from capture.calibration.ps4cal import CalibrationFile, PartRecord
from capture.calibration.setting import Setting
from classify.calibration.dark import Dark
from rig import Rig, RigConfig, open_rig
from rig.simulation.rig import Simulation
from tests.rig.cameras.test_opencv import V4l2Video
from tests.rig.cameras.v4l2.test_measurement_mode import StreamingCamera

CAMERA = {"width_px": 64, "height_px": 48, "exposure_ms": 5.0, "frame_rate_hz": 100.0}
Opener = Callable[[float], AbstractContextManager[Rig]]


@contextmanager
def device_rig(kind: str, gain: float) -> Iterator[Rig]:
    """Open a rig with a camera that is a device, and a simulated light controller."""
    simulation = Simulation(RigConfig())
    camera = CAMERA | {"kind": kind, "device": "/dev/video9", "bits": 8, "gain": int(gain)}
    try:
        lights = {"port": simulation.port}
        with open_rig(RigConfig.model_validate({"lights": lights, "camera": camera})) as rig:
            yield rig
    finally:
        simulation.close()


@contextmanager
def simulated_rig(gain: float) -> Iterator[Rig]:
    with open_rig(RigConfig().with_changes(camera=CAMERA)) as rig:
        sensor = rig.camera.sensor
        rig.camera.sensor = replace(sensor, full_well_e=sensor.full_well_e / gain)
        yield rig


@pytest.fixture(params=["simulated", "replay", "opencv", "v4l2"])
def opener(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Opener:
    """A function that opens a rig with a camera of one kind at a gain."""

    def replay_rig(gain: float) -> AbstractContextManager[Rig]:
        with simulated_rig(1.0) as rig:
            captured = capture_set(rig)
        assert captured.metadata.camera is not None
        camera = captured.metadata.camera.model_copy(update={"gain": gain})
        metadata = captured.metadata.model_copy(update={"camera": camera})
        CapturedSet(captured.images, captured.ambient, metadata).save(tmp_path / "a.ome.tif")
        replayed = CAMERA | {"kind": "replay", "set_file": str(tmp_path / "a.ome.tif")}
        return open_rig(RigConfig().with_changes(camera=replayed))

    monkeypatch.setattr(cv2, "VideoCapture", V4l2Video)
    monkeypatch.setattr("rig.cameras.v4l2.camera.V4l2Device", StreamingCamera)
    openers: dict[str, Opener] = {"simulated": simulated_rig, "replay": replay_rig}
    return openers.get(request.param, lambda gain: device_rig(request.param, gain))


def test_dark_does_not_hold_at_another_gain(opener: Opener) -> None:
    with opener(2.0) as rig:
        first = Setting.of_rig(rig)
    record = PartRecord(setting=first, quality="", source=())
    dark = Dark(2.0, 1.0, np.empty((0, 2), np.int32), None, 255.0)
    file = CalibrationFile().with_part("dark", dark, record)
    assert first.gain is not None
    assert first.gamma is not None
    assert first.pixel_value_controls
    assert first.exposure_ms == pytest.approx(5.0)
    with opener(2.0) as rig:
        check_setting(file, Setting.of_rig(rig), "this rig")
    with opener(4.0) as rig:
        assert Setting.of_rig(rig).gain == pytest.approx(2.0 * first.gain)
        with pytest.raises(CalibrationError, match=r"gain [\d.]+ instead of [\d.]+ \(dark\)"):
            check_setting(file, Setting.of_rig(rig), "this rig")
