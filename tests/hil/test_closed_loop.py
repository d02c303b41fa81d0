"""Capture in the guest through kernel drivers; solve and classify on the host."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from capture import CapturedSet
from capture.calibration.ps4cal import CalibrationFile
from capture.cli import app
from classify import Lighting
from rig import synthetic_surface
from rig.scene.render import render_frame
from rig.scene.synthetic import tile_side_px
from rig.simulation.sensor import SensorModel

from .checks import (
    GUEST,
    Outcomes,
    assert_passed,
    compile_for_guest,
    names_in,
    run_checks,
)
from .guest.loop_bench import (
    EXPOSURE_MS,
    HOT_PIXELS,
    ROTATE_DEG,
    SEED,
    SETS,
    SIDE_PX,
    SURFACE,
)

pytestmark = pytest.mark.kernel

CHECKS = GUEST / "loop_checks.py"
# As few buffers as a camera has.
MODULES = {
    "dummy_hcd": "",
    "usb_f_acm": "",
    "cdc_acm": "",
    "v4l2loopback": "video_nr=9 max_buffers=4",
}
TEXTURES = ("rock", "sand", "malv", "ogil")


@dataclass(frozen=True)
class Loop:
    """The outcomes of the guest's checks, and the folder with its sets."""

    outcomes: Outcomes
    shared: Path

    @property
    def sets(self) -> list[Path]:
        return sorted(self.shared.glob("part-*.ome.tif"))


def run(*arguments: object) -> str:
    """Run ps4rig on the host, in this process; it must succeed."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Loop:
    shared = tmp_path_factory.mktemp("loop")
    rendered = ("--surface", SURFACE, "--rotate", ROTATE_DEG, "--size", SIDE_PX)
    environment = compile_for_guest(shared, *rendered)
    outcomes = run_checks(CHECKS, shared, modules=MODULES, environment=environment)
    return Loop(outcomes, shared)


@pytest.mark.parametrize("name", names_in(CHECKS))
def test_in_the_guest(loop: Loop, name: str) -> None:
    assert_passed(loop.outcomes, name)


def test_every_image_is_what_its_light_alone_shows(loop: Loop) -> None:
    """A stale or mixed frame would differ by many times its noise."""
    surface = synthetic_surface(SURFACE, SEED, tile_side_px(SIDE_PX))
    scene = render_frame(surface, Lighting.ring(slant_deg=45.0), SIDE_PX, ROTATE_DEG)
    sensor = SensorModel(bit_depth=16)
    assert len(loop.sets) == SETS
    for path in loop.sets:
        captured = CapturedSet.load(path)
        # The controller reports it over any line.
        assert captured.metadata.simulated
        assert captured.ambient is not None
        images = [*captured.images, captured.ambient]
        for image, light in zip(images, [*scene.lights, 0.0], strict=True):
            signal_e = sensor.white_e_per_ms * EXPOSURE_MS * (scene.ambient + light)
            noise_e = np.sqrt(signal_e + sensor.read_noise_e**2)
            seen_e = (image - sensor.black_level_dn) * sensor.gain_e_per_dn
            off = (seen_e - signal_e) / noise_e
            assert abs(off.mean()) < 0.05
            assert off.std() == pytest.approx(1.0, abs=0.05)


def test_every_frame_began_after_its_light_had_settled(loop: Loop) -> None:
    images = [image for path in loop.sets for image in CapturedSet.load(path).metadata.images]
    for image in images:
        (frame,) = image.frames
        assert image.led_acknowledged_s is not None
        assert frame.exposure_start_s >= image.led_acknowledged_s + 0.02


def test_solve_accepts_the_set(loop: Loop) -> None:
    run("solve", loop.sets[0], "--out", loop.shared / "maps")
    assert (loop.shared / "maps" / "normals.tif").exists()


def test_the_calibration_describes_the_sensor(loop: Loop) -> None:
    file, sensor = CalibrationFile.read(loop.shared / "rig.ps4cal"), SensorModel(bit_depth=16)
    dark = file.calibration.dark
    assert file.records["dark"].setting.simulated
    assert dark.offset == pytest.approx(sensor.black_level_dn, rel=0.01)
    assert dark.noise == pytest.approx(sensor.read_noise_dn, rel=0.05)
    assert len(dark.hot_pixels) == HOT_PIXELS


def test_classify_finds_the_texture_and_its_angle(loop: Loop) -> None:
    known = []
    for name in TEXTURES:
        known.append(loop.shared / f"{name}.ome.tif")
        run(
            *("capture", "--rig", "sim", "--surface", name, "--size", SIDE_PX),
            *("--label", name, known[-1]),
        )
    library = loop.shared / "four.ps4lib"
    run("train", *known, "--library", library)
    for match in json.loads(run("classify", *loop.sets, "--library", library, "--json")):
        assert match["label"] == SURFACE
        assert match["orientation_deg"] == pytest.approx(ROTATE_DEG, abs=5.0)
