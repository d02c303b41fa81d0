"""Keys of a GenICam camera, the clock of its stamps, and what its network lacks."""

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig import CameraError, ConfigError, RigConfig
from rig.cameras.camera import CameraInfo
from rig.cameras.genicam import camera as genicam_camera
from rig.cameras.genicam.aravis import Buffer, aravis, find_devices
from rig.cameras.genicam.camera import DeviceClock, list_genicam_cameras
from rig.doctor.devices import RULES_FILE, check_cameras

CAMERA = {"kind": "genicam", "device": "Basler-1"}


def camera_of(**keys: object) -> object:
    lights = {"port": "/dev/ttyACM0"}
    return RigConfig.model_validate({"lights": lights, "camera": CAMERA | keys}).camera


def test_the_pixel_format_determines_the_depth() -> None:
    assert camera_of(pixel_format="Mono12p").bits == 12
    assert "Mono12p 512x512" in camera_of(pixel_format="Mono12p").mode
    for wrong in ({"pixel_format": "Mono11"}, {"bits": 12}, {"trigger_line": "1;"}, {"gain": -1.0}):
        with pytest.raises((ConfigError, ValueError), match=next(iter(wrong))):
            camera_of(**wrong)


def no_typelib(_name: str, _version: str) -> None:
    raise ValueError("Namespace Aravis not available")


@pytest.mark.parametrize("gi", [None, SimpleNamespace(require_version=no_typelib)])
def test_without_pygobject_or_aravis_the_way_out_is_named(
    monkeypatch: pytest.MonkeyPatch, gi: object
) -> None:
    monkeypatch.setitem(sys.modules, "gi", gi)
    aravis.cache_clear()
    try:
        assert list_genicam_cameras() == []
        with pytest.raises(CameraError, match=r"ps4rig\[genicam\].*apt install gir1.2-aravis-0.8"):
            find_devices()
    finally:
        aravis.cache_clear()


@given(
    delays_s=st.lists(st.floats(0.0, 0.2), min_size=2, max_size=20),
    ahead_s=st.floats(-1e6, 1e6),
)
def test_a_stamp_is_late_by_the_least_delay_and_never_by_more(
    delays_s: list[float], ahead_s: float
) -> None:
    clock, began_s = DeviceClock(), time.monotonic() - 100.0
    for number, delay_s in enumerate(delays_s):
        exposed_s = began_s + number / 30.0
        utc_ns = time.time_ns() - round(1e9 * (time.monotonic() - exposed_s - delay_s))
        device_ns = round(1e9 * (exposed_s + ahead_s + 2e6))
        stamp_s = clock.stamp_s(Buffer(b"", (1, 1), number, device_ns, utc_ns))
        least_s = min(delays_s[: number + 1])
        assert stamp_s - exposed_s == pytest.approx(least_s, abs=2e-3)


def test_a_usb_camera_that_may_not_be_opened_is_listed_with_the_rules(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = {"bInterfaceClass": "ef", "bInterfaceSubClass": "05", "bInterfaceProtocol": "00"}
    usb = {"busnum": "250", "devnum": "7", "serial": "S7", "product": "Blackfly S"}
    for folder, files in (("2-1:1.0", values), ("2-1", usb), ("3-1:1.0", {})):
        (tmp_path / folder).mkdir()
        for name, text in files.items():
            (tmp_path / folder / name).write_text(f"{text}\n")
    monkeypatch.setattr(genicam_camera, "USB_DEVICES", tmp_path)
    monkeypatch.setattr(genicam_camera, "find_devices", list)
    (camera,) = list_genicam_cameras()
    (check,) = check_cameras([camera], None)
    assert check.seen == "Blackfly S S7: you may not read and write /dev/bus/usb/250/007"
    assert str(RULES_FILE) in check.advice


def info(width_px: int, rate_hz: float, packet_bytes: int = 1500, **link: float) -> CameraInfo:
    record = {"pixel_format": "Mono12p", "packet_bytes": packet_bytes} | link
    return CameraInfo(
        "genicam", "a camera", width_px, 1000, 12, 1.0 / rate_hz, 0.01, 4,
        controls={"genicam": record},
    )  # fmt: skip


def test_a_network_that_is_too_slow_for_the_frames_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rmem_max = tmp_path / "rmem_max"
    monkeypatch.setattr(genicam_camera, "MAX_BUFFER_FILE", rmem_max)
    rmem_max.write_text("8000000\n")

    def faults(camera: CameraInfo) -> list[str]:
        return [fault.name for fault in genicam_camera.network_faults(camera)]

    assert faults(info(1000, 20.0)) == []
    assert faults(info(1000, 50.0)) == ["packet size"]
    assert faults(info(1000, 50.0, 9000)) == []
    assert faults(info(4000, 20.0, 9000)) == ["network rate", "socket buffer"]
    assert faults(info(1000, 100.0, 9000, link_mbit_per_s=5000.0)) == []
