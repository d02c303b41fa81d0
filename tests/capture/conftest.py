"""Fixtures of a small simulated rig, of captured sets on disk and of the command line."""

import functools
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import typer.testing

from capture import CapturedSet, SetMetadata, capture_set
from capture.calibration.ps4cal import CalibrationFile, PartRecord
from capture.calibration.setting import Setting
from capture.cli import app
from capture.sets.metadata import ImageRecord, LightingRecord
from classify import Lighting
from classify.calibration.calibration import CalibratedLights
from classify.calibration.flat_field import PlateBlocks, fit_flat_field
from classify.images import ImageStack
from rig import Rig, RigConfig, open_rig
from rig.set_file import pixels_sha256
from tests.led_outputs import settled_outputs

_LOG = logging.getLogger(__name__)
# All commands are built anew for each call otherwise, which takes longer than most of them run.
typer.testing._get_command = functools.cache(typer.testing._get_command)
COMMAND = (sys.executable, "-m", "capture")
Images = npt.NDArray[np.uint16]


@pytest.fixture(scope="session")
def small_config() -> RigConfig:
    return RigConfig().with_changes(camera={"width_px": 64, "height_px": 64})


@pytest.fixture(scope="session")
def near_config() -> RigConfig:
    """A rig whose LEDs are two and a half fields of view away and unequal, above a white sheet."""
    return RigConfig().with_changes(
        camera={"width_px": 128, "height_px": 128, "exposure_ms": 15.0},
        simulation={
            "led_distance_px": 320.0,
            "led_levels": (1.0, 0.9, 1.05, 0.85),
            "placement": {"surface": "plate"},
        },
    )


@pytest.fixture(scope="session")
def near_calibration(near_config: RigConfig) -> CalibrationFile:
    """The flat field of the near rig, measured, and the true positions of its LEDs."""
    with open_rig(near_config) as opened:
        plate = capture_set(opened, average=4, is_target=True)
        record = PartRecord(setting=Setting.of_rig(opened), quality="", source=("captured",))
        near = Lighting.near(320.0 * opened.lighting.directions)
    stack = ImageStack(plate.images, plate.ambient)
    blocks = PlateBlocks.of([stack], plate.metadata.full_scale)
    lights = CalibratedLights(near, "plate", np.zeros(4), np.zeros(4), 0.0, 1.0)
    flat = CalibrationFile().with_part("flat_field", fit_flat_field(blocks).flat_field, record)
    return flat.with_part("lights", lights, record)


@pytest.fixture
def rig(small_config: RigConfig) -> Iterator[Rig]:
    with open_rig(small_config) as opened:
        yield opened


def _led_outputs(rig: Rig) -> list[float]:
    """The light of the simulated LEDs, also of a closed rig."""
    assert rig.simulation is not None
    return settled_outputs(rig.clock, rig.simulation.board)


@pytest.fixture(scope="session")
def led_outputs() -> Callable[[Rig], list[float]]:
    return _led_outputs


def make_set(
    pixels: Images,
    ambient: Images | None = None,
    lighting: Lighting | None = None,
    mask: npt.NDArray[np.bool_] | None = None,
    **fields: object,
) -> CapturedSet:
    """Make a set from pixels of shape (lights, rows, columns)."""
    tilts_deg = [360.0 * light / len(pixels) for light in range(len(pixels))]
    lights: list[int | None] = list(range(len(pixels)))
    if ambient is not None:
        lights.append(None)
    values: dict[str, object] = {
        "label": "oak",
        "created_utc": "2026-01-02T03:04:05Z",
        "simulated": False,
        "bit_depth": 16,
        "full_scale": 65535,
        "lighting": LightingRecord.of(lighting or Lighting.ring(45.0, tilts_deg)),
        "images": tuple(ImageRecord(light=light) for light in lights),
        "software_version": "0",
        "pixels_sha256": pixels_sha256(pixels, ambient, mask),
        "mask_file": None if mask is None else "mask.png",
    }
    return CapturedSet(pixels, ambient, SetMetadata.model_validate(values | fields), mask)


@pytest.fixture(scope="session")
def made_set() -> Callable[..., CapturedSet]:
    return make_set


@pytest.fixture(scope="session")
def ps4rig() -> Callable[..., Any]:
    """Run the command in this process; the result has exit_code, stdout and stderr."""

    def run(*arguments: object, typed: str | None = None) -> Any:
        result = typer.testing.CliRunner().invoke(
            app, [str(argument) for argument in arguments], input=typed
        )
        if result.exit_code:  # shown with a test that fails
            _LOG.warning("status %d: %s", result.exit_code, result.stderr)
        return result

    return run


@pytest.fixture(scope="session")
def refused(ps4rig: Callable[..., Any]) -> Callable[..., str]:
    """Run a command that must fail with one line on stderr; return the line."""

    def run(*arguments: object, status: int = 2) -> str:
        result = ps4rig(*arguments)
        assert result.exit_code == status, (result.stdout, result.stderr, result.exception)
        assert result.stdout == ""
        (line,) = result.stderr.splitlines()
        assert line.startswith("ps4rig: ")
        return line.removeprefix("ps4rig: ")

    return run


@pytest.fixture(scope="session")
def spawn() -> Callable[..., subprocess.Popen[str]]:
    """Start the command in a separate process."""

    def start(*arguments: object, **options: object) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [*COMMAND, *map(str, arguments)],
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            **({"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE} | options),
        )

    return start


@pytest.fixture(scope="session")
def run_python() -> Callable[..., str]:
    """Run a program in a separate process, without an error; return its standard output."""

    def run(program: str, *arguments: str, before: tuple[str, ...] = (), **changed: str) -> str:
        done = subprocess.run(
            [*before, sys.executable, "-c", program, *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | changed,
            timeout=300.0,
        )
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout

    return run


@pytest.fixture
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make an empty folder the working folder."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture(scope="session")
def sets(tmp_path_factory: pytest.TempPathFactory, ps4rig: Callable[..., Any]) -> Path:
    """A read-only folder with sets of rock and sand at two orientations, 128 px wide."""
    folder = tmp_path_factory.mktemp("sets")
    for name in ("rock", "sand"):
        result = ps4rig(
            "capture", "--rig", "sim", "--surface", name, "--label", name, "--size", 128,
            "--rotate", 0, "--rotate", 50, folder / f"{name}.ome.tif",
        )  # fmt: skip
        assert result.exit_code == 0, result.stderr
    return folder


@pytest.fixture(scope="session")
def library(sets: Path, ps4rig: Callable[..., Any]) -> Path:
    """A library of rock and sand at an orientation of 0 degrees."""
    path = sets.parent / "textures.ps4lib"
    paths = (sets / "rock-001.ome.tif", sets / "sand-001.ome.tif")
    result = ps4rig("train", *paths, "--library", path)
    assert result.exit_code == 0, result.stderr
    return path
