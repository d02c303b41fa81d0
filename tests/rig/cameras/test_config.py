"""The section [camera] of rig.toml: defaults of each kind, refused values, messages."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rig import (
    CameraError,
    ConfigError,
    LightControllerError,
    RigConfig,
    open_rig,
)
from rig.cameras.v4l2.camera import V4l2Camera
from rig.cameras.v4l2.measurement_mode import V4l2CameraConfig

Load = Callable[[str], RigConfig]
REAL = '[lights]\nport = "/dev/ttyACM0"\n[camera]\n'
CAMERA = REAL + 'kind = "v4l2"\ndevice = "/dev/v4l/by-id/cam"\n'


@pytest.mark.parametrize(("name", "bits"), [("Y10", 10), ("SRGGB12", 12), ("GREY", 8)])
def test_bits_follow_the_pixel_format(load: Load, name: str, bits: int) -> None:
    config = load(CAMERA + f'pixel_format = "{name}"\n')
    assert config.camera.bits == bits


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (REAL + 'kind = "v4l2"\n', r"device is missing; .*/dev/v4l/by-id"),
        (REAL + 'kind = "simulated"\ndevice = "/dev/video0"\n', r"set kind = 'v4l2'"),
        (CAMERA + 'set_file = "a.ome.tif"\n', r"set_file = .*kind = 'replay'"),
        (REAL + 'kind = "opencv"\n', r"device is missing"),
        (REAL + 'kind = "opencv"\ndevice = 0\nbits = 12\n', r"camera\.bits = 12: must be 8"),
        (
            REAL + 'kind = "opencv"\ndevice = 0\ntimestamp_offset_ms = 3\n',
            r"timestamp_offset_ms = 3: .*kind = 'opencv'",
        ),
        (REAL + 'kind = "replay"\n', r"set_file is missing"),
        (CAMERA + "readout_ms = 40\n", r"readout_ms = 40 .* 30 Hz"),
        (CAMERA + 'pixel_format = "NV12"\n', r"camera\.pixel_format.*'NV12' is unknown.*GREY, Y10"),
        (CAMERA + "bits = 12\n", r"bits = 12, but pixel_format = 'GREY' has 8"),
        (CAMERA + 'pixel_format = "MJPG"\n', r"lossy; .*allow_compressed = true"),
        (CAMERA + "widht_px = 9\n", r"camera\.widht_px = 9: .*width_px\?"),
        (CAMERA.replace("/dev/ttyACM0", "simulated"), r"'v4l2' .*simulated LEDs"),
    ],
)
def test_wrong_camera_values_are_refused(load: Load, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load(text)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        (REAL + "device = 0\n", "v4l2"),
        (REAL + 'device = 0\nkind = "opencv"\n', "opencv"),
        ('[lights]\nport = "simulated"\n', "simulated"),
    ],
)
def test_the_default_kind_follows_the_lights(load: Load, text: str, kind: str) -> None:
    assert load(text).camera.kind == kind
    assert RigConfig().camera.kind == "simulated"


def test_a_timing_of_another_mode_is_refused(load: Load) -> None:
    mode = "GREY 512x512, 30 Hz, 20 ms"
    timing = f'timestamp_offset_ms = -2\nreadout_ms = 8\ntiming_measured_at = "{mode}"\n'
    assert load(CAMERA + timing).camera.mode == mode
    changed = load(CAMERA + timing + "exposure_ms = 10\n").camera
    with pytest.raises(ConfigError, match=r"512x512, 30 Hz, 10 ms'; .*ps4rig rig latency"):
        V4l2Camera(changed)


def test_mjpg_may_be_allowed(load: Load) -> None:
    text = CAMERA + 'pixel_format = "MJPG"\nallow_compressed = true\n'
    assert load(text).camera.bits == 8


@pytest.mark.parametrize(
    ("changes", "claims_start", "start_s"),
    [
        # 100 s minus the exposure of 20 ms and a readout of a whole period of 1/25 s
        ({}, False, 99.94),
        ({}, True, 99.94),
        ({"readout_ms": 5.0}, True, 99.975),
        ({"timestamp_marks": "driver"}, False, 99.94),
        ({"timestamp_marks": "driver"}, True, 100.0),
        ({"timestamp_marks": "driver", "timestamp_offset_ms": -3.0}, True, 99.997),
        ({"readout_ms": 0.0, "timestamp_offset_ms": 1.0}, False, 99.981),
        ({"readout_ms": 5.0, "timestamp_uncertainty_ms": 2.0}, False, 99.973),
    ],
)
def test_a_stamp_is_the_frames_end_unless_the_driver_is_believed(
    changes: dict[str, object], claims_start: bool, start_s: float
) -> None:
    config = V4l2CameraConfig.model_validate({"kind": "v4l2", "device": "/dev/video0"} | changes)
    start = config.exposure_start_s(
        100.0, claims_start=claims_start, period_s=0.04, exposure_s=0.02
    )
    assert start == pytest.approx(start_s)


def camera_at(device: str) -> V4l2CameraConfig:
    return V4l2CameraConfig(device=device)


def test_a_missing_camera_is_named() -> None:
    with pytest.raises(CameraError, match=r"/dev/v4l/by-id/none: no such camera"):
        V4l2Camera(camera_at("/dev/v4l/by-id/none"))


@pytest.mark.parametrize(
    ("device", "cause"),
    [
        *((device, "is no video device") for device in ("/dev/null", "/dev/ptmx", __file__)),
        ("/", "cannot be opened: Is a directory"),
    ],
)
def test_a_device_that_is_not_a_camera_is_named(device: str, cause: str) -> None:
    with pytest.raises(CameraError, match=f"{device}: {cause}"):
        V4l2Camera(camera_at(device))


def test_open_rig_opens_the_lights_before_the_camera(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(CAMERA.replace("/dev/ttyACM0", str(tmp_path / "no-port")))
    with pytest.raises(LightControllerError, match="no-port"):
        open_rig(path)
