"""What cameras of makers do otherwise than Aravis' fake camera, by changes of its features."""

import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.cameras.genicam.aravis import AravisCamera, Buffer, aravis
from rig.cameras.genicam.camera import GenicamCamera, list_genicam_cameras
from rig.cameras.genicam.measurement_mode import (
    GenicamCameraConfig,
    Settings,
    set_measurement_mode,
)
from rig.errors import CameraError, ControlError

pytestmark = pytest.mark.genicam

DEVICE = "Fake_1"
END = '<Port Name="Device"'
Change = tuple[str, str]


def config(**keys: Any) -> GenicamCameraConfig:
    size = {"width_px": 64, "height_px": 48}
    return GenicamCameraConfig(device=DEVICE, exposure_ms=15.0, **size, **keys)


def added(features: str) -> Change:
    return END, f"{features}\n{END}"


def replaced(kind: str, name: str, by: str, value: object) -> Change:
    """Change a feature into one that begins with a value."""
    feature = f'<{by} Name="{name}"><Value>{value}</Value></{by}>'
    return f'<{kind} Name="{name}"', f'{feature}<{kind} Name="Former{name}"'


def switch(name: str, value: int) -> str:
    return (
        f'<Integer Name="{name}Value"><Value>{value}</Value></Integer>'
        f'<Boolean Name="{name}"><pValue>{name}Value</pValue></Boolean>'
    )


@pytest.fixture
def describe(tmp_path: Path) -> Iterator[Callable[..., None]]:
    """Change the description of the fake camera of this process."""
    path = tmp_path / "features.xml"

    def describe(*changes: Change) -> None:
        features = aravis().FakeCamera.new("any").get_genicam_xml()[0]
        for old, new in changes:
            assert old in features
            features = features.replace(old, new)
        path.write_text(features, encoding="utf-8")
        aravis().set_fake_camera_genicam_filename(str(path))

    aravis().enable_interface("Fake")
    yield describe
    # PyGObject passes no NULL, which brings the description of Aravis back.
    ctypes.CDLL("libaravis-0.8.so.0").arv_set_fake_camera_genicam_filename(None)
    aravis().disable_interface("Fake")


NO_SELECTOR = ('"TriggerSelector"', '"NoSelector"')
BURST = (('"FrameStart"', '"FrameBurstStart"'), ('"AcquisitionStart" NameSpace', '"End" NameSpace'))
LIMITED = (
    replaced("IntReg", "ExposureTimeAbsRegister", "Integer", 200_000),
    added(
        '<SwissKnife Name="MaxRate"><pVariable Name="US">ExposureTimeAbs</pVariable>'
        "<Formula>1000000 / US</Formula></SwissKnife>"
    ),
    (
        "<pValue>AcquisitionFrameRateConverter</pValue>",
        "<pValue>AcquisitionFrameRateConverter</pValue><pMax>MaxRate</pMax>",
    ),
)
GAMMA = switch("GammaEnable", 0) + (
    '<Float Name="Gamma"><pValue>GammaRegister</pValue></Float><FloatReg Name="GammaRegister">'
    "<Address>0x400</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort>"
    "<Endianess>BigEndian</Endianess></FloatReg>"
)
SINGLE = replaced("IntReg", "AcquisitionModeRegister", "Integer", 2)
LIMIT = switch("AcquisitionFrameRateEnable", 1)
LINE = {"trigger_line": "Line0"}


@pytest.mark.parametrize(
    ("changes", "keys", "feature", "value"),
    [
        ([SINGLE], {}, "AcquisitionMode", "Continuous"),
        ([NO_SELECTOR], LINE, "TriggerMode", "On"),
        (BURST, LINE, "TriggerSelector", "FrameBurstStart"),
        ([added(LIMIT)], LINE, "AcquisitionFrameRateEnable", False),
        ([added(switch("ChunkModeActive", 1))], {}, "ChunkModeActive", False),
        ([added(switch("LUTEnable", 1))], {}, "LUTEnable", False),
        ([added(GAMMA)], {"gamma": 0.45}, "GammaEnable", True),
        (LIMITED, {}, "AcquisitionFramePeriod", 33333),
    ],
)
def test_the_measurement_mode_holds(
    describe: Callable[..., None],
    changes: list[Change],
    keys: dict[str, Any],
    feature: str,
    value: bool | int | str,
) -> None:
    describe(*changes)
    camera = AravisCamera(DEVICE)
    set_measurement_mode(camera, config(**keys))
    assert camera.value(feature, type(value)) == value


def test_a_value_that_holds_is_not_written() -> None:
    class ReadOnlyCamera:
        def value(self, *_: object) -> str:
            return "Off"

        def set_value(self, *_: object) -> None:
            raise CameraError("write protected")

    settings = Settings(ReadOnlyCamera())
    settings.set("TestPattern", "Off")
    assert settings.faults == []


def test_a_rate_that_is_not_reached_is_refused(describe: Callable[..., None]) -> None:
    describe(added('<Float Name="ResultingFrameRateAbs"><Value>23.0</Value></Float>'))
    with pytest.raises(ControlError, match=r"frame_rate_hz was set to 30.* and reads 23"):
        GenicamCamera(config())


def test_values_of_pixels_may_be_integers_and_a_gamma_switched_off(
    describe: Callable[..., None],
) -> None:
    describe(added('<Integer Name="DigitalShift"><Value>3</Value></Integer>' + GAMMA))
    camera = GenicamCamera(config())
    camera.close()
    assert camera.info.pixel_value_controls == {"DigitalShift": 3.0}
    assert camera.info.gamma == 1.0


def test_steps_of_the_exposure_are_no_microseconds(describe: Callable[..., None]) -> None:
    steps = '<Integer Name="ExposureTimeRaw"><Value>1</Value><Min>1</Min><Max>999</Max></Integer>'
    describe(
        replaced("StringReg", "DeviceVendorName", "String", "Basler"),
        replaced("StringReg", "DeviceModelName", "String", "acA1920-25gm"),
        added(steps),
    )
    assert AravisCamera(DEVICE).exposure_range_ms == (0.01, 10_000.0)


def test_a_colour_camera_gets_a_raw_format(describe: Callable[..., None]) -> None:
    describe(('"Mono8"', '"BGR8"'), ('"Mono16"', '"YUV422"'))
    (listed,) = (camera for camera in list_genicam_cameras() if camera.device == DEVICE)
    assert 'pixel_format = "BayerRG8"' in listed.config_lines


def test_a_frame_may_state_no_size(
    describe: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    describe()
    camera = GenicamCamera(config())
    sizeless = Buffer(bytes(64 * 48), (0, 0), 1, 0, 0)
    monkeypatch.setattr(AravisCamera, "next_buffer", lambda *_: sizeless)
    assert camera.read(1.0).pixels.shape == (48, 64)
    camera.close()
