"""A new kind of camera is a file (here, this one) and a row: everything then knows it."""

import ast
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import pytest
from pydantic import Field
from typer.testing import CliRunner

from capture import CapturedSet
from capture.cli import app
from rig import CameraInfo, Frame, ListedCamera, RigConfig, load_config, open_rig
from rig.cameras.config import DeviceCameraConfig, StampedCameraConfig
from rig.cameras.kinds import CAMERA_KINDS, CameraKind
from rig.simulation.rig import Simulation
from tests.test_architecture import FILES, ROOMS, ROOT, imports_of, parsed, text_of

SIZE = {"width_px": 96, "height_px": 96}


class FactoryCameraConfig(DeviceCameraConfig, StampedCameraConfig):
    """A camera that is found by its serial number, with a gain in dB."""

    kind: Literal["factory"] = "factory"
    gain_db: float = Field(default=0.0, ge=0.0, le=48.0)


class FactoryCamera:
    """Frames of a simulated camera, as the frames of a device."""

    def __init__(self, config: FactoryCameraConfig, simulation: Simulation) -> None:
        self._config = config
        self._camera = simulation.camera_with_faults

    @property
    def info(self) -> CameraInfo:
        name = f"factory camera {self._config.device}"
        return replace(
            self._camera.info, kind="factory", name=name, gain=self._config.gain_db, gamma=None
        )

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        return self._camera.exposure_range_ms

    def set_exposure(self, exposure_ms: float) -> None:
        self._camera.set_exposure(exposure_ms)

    def read(self, timeout_s: float) -> Frame:
        return self._camera.read(timeout_s)

    def close(self) -> None:
        """The simulation outlives it, because more than one command opens the camera."""


def listed() -> list[ListedCamera]:
    lines = ("gain_db = 1.5", *(f"{key} = {value}" for key, value in SIZE.items()))
    camera = ListedCamera("factory", "SN-7", "Factory 5M", "USB3 Vision", None, ("Mono12",), 25.0)
    return [replace(camera, config_lines=lines)]


@pytest.fixture
def simulation(monkeypatch: pytest.MonkeyPatch) -> Iterator[Simulation]:
    """A rig whose LEDs answer on a port, and whose camera is of the new kind, the only listed."""
    config = RigConfig().with_changes(camera=SIZE, simulation={"clock": "real"})
    simulation = Simulation(config)
    row = CameraKind(FactoryCameraConfig, lambda camera: FactoryCamera(camera, simulation), listed)
    for name, kind in CAMERA_KINDS.items():  # this machine may have cameras
        monkeypatch.setitem(CAMERA_KINDS, name, replace(kind, lister=None))
    monkeypatch.setitem(CAMERA_KINDS, "factory", row)
    yield simulation
    simulation.close()


@pytest.fixture
def rig(simulation: Simulation, tmp_path: Path) -> Path:
    """The rig.toml that `rig init` writes for it."""
    path = tmp_path / "rig.toml"
    run("rig", "init", path, "--port", simulation.port)
    return path


def run(*arguments: object) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_the_table_alone_knows_the_kinds_of_devices() -> None:
    devices = {name for name, kind in CAMERA_KINDS.items() if kind.opener is not None}
    assert {"v4l2", "genicam"} <= devices
    knowing = []
    for path in FILES:
        if path.parent == ROOT / "rig" / "cameras" or path.parent.name in devices:
            continue
        modules = {f"rig.cameras.{name}" for name in devices}
        compared = {
            value.value
            for node in ast.walk(parsed(text_of(path)))
            if isinstance(node, ast.Compare | ast.MatchValue)
            for value in ast.walk(node)
            if isinstance(value, ast.Constant)
        }
        if compared & devices or any(
            name.startswith(module) for name in imports_of(path) for module in modules
        ):
            knowing.append(path)
    assert knowing == []


def test_a_kind_is_named_in_its_folder_and_its_row_alone() -> None:
    named = [
        path
        for room in ROOMS
        for path in (ROOT / room).rglob("*")
        if path.suffix in {".py", ".pyi", ".rules", ".toml", ".html", ".js", ".json", ".yaml"}
        and "genicam" not in path.parts
        and any(word in path.read_text("utf-8").lower() for word in ("genicam", "gige", "aravis"))
    ]
    assert named == [ROOT / "rig" / "cameras" / "kinds.py"]


def test_rig_init_lists_it_and_writes_its_keys(rig: Path) -> None:
    assert "Factory 5M (USB3 Vision)" in rig.read_text()
    camera = load_config(rig).camera
    assert isinstance(camera, FactoryCameraConfig)
    assert (camera.device, camera.gain_db, camera.width_px) == ("SN-7", 1.5, 96)


def written(rig: Path, camera: dict[str, object]) -> Path:
    keys = {key: value for key, value in camera.items() if value is not None}
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    rig.write_text(rig.read_text().split("[camera]")[0] + "[camera]\n" + "\n".join(lines))
    return rig


def test_the_doctor_checks_it(rig: Path) -> None:
    checks = {
        check["name"]: check
        for check in json.loads(run("rig", "doctor", "--rig", rig, "--json"))["checks"]
    }
    assert "SN-7: Mono12" in checks["camera"]["seen"]
    assert checks["measurement mode"]["seen"].startswith("factory camera SN-7")
    assert checks["frame rate"]["status"] == "ok"
    absent = load_config(rig).camera.model_dump() | {"device": "SN-8"}
    result = CliRunner().invoke(app, ["rig", "doctor", "--rig", str(written(rig, absent))])
    assert result.exit_code == 1
    assert "SN-8 is not among" in result.stdout.replace("\n", " ")


def test_it_is_opened_and_captures_a_set(rig: Path, tmp_path: Path) -> None:
    with open_rig(rig) as opened:
        assert not opened.config.is_simulated
        opened.lights.select(1)
        assert opened.camera.read(timeout_s=2.0).pixels.shape == (96, 96)
    path = tmp_path / "rock.ome.tif"
    run("capture", "--rig", rig, path)
    camera = CapturedSet.load(path).metadata.camera
    assert camera is not None
    assert (camera.kind, camera.name) == ("factory", "factory camera SN-7")
    assert camera.gain == 1.5


def test_simulated_leds_refuse_it() -> None:
    config = {"camera": {"kind": "factory", "device": "SN-7"}}
    with pytest.raises(ValueError, match=r"'simulated', 'v4l2', 'opencv'"):
        RigConfig.model_validate(config)
