"""A rig of simulated devices, used like a real one. Runs as root in the guest.

The firmware answers at the far end of a USB gadget, and frames come out of v4l2loopback.
"""

import os
import re
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from capture import capture_set
from firmware_sim import RealClock, SimulatedBoard, SimulatedController, serve_tty
from rig import CameraError, RigConfig, load_config, open_rig
from rig.cameras.v4l2.camera import V4l2Camera
from rig.cameras.v4l2.output import V4l2Output
from rig.cameras.v4l2.pixel_formats import PIXEL_FORMATS
from rig.lights.driver import LightController
from tests.hil.guest.loop_bench import (
    HOT_PIXELS,
    PERIOD_S,
    SETS,
    SHARED,
    SIDE_PX,
    VIDEO,
    ForkedProgram,
    rig_toml,
    simulated_rig,
)
from tests.hil.guest.serial_bench import GADGET, Gadget, port_of, wait_for


@pytest.fixture(scope="module")
def gadget() -> Gadget:
    return Gadget(GADGET)


@pytest.fixture(scope="module")
def config(gadget: Gadget) -> Path:
    path = SHARED / "rig.toml"
    port_of(gadget.serial_number)
    path.write_text(rig_toml())
    return path


@pytest.fixture(scope="module", autouse=True)
def imports() -> None:
    """What the programs need, loaded once: they are forks of this process."""
    size = {"width_px": SIDE_PX, "height_px": SIDE_PX, "bits": 16}
    with open_rig(RigConfig().with_changes(camera=size)) as rig:
        capture_set(rig).save(Path("/dev/shm/imports.ome.tif"))


@pytest.fixture(scope="module")
def simulation(gadget: Gadget, config: Path) -> Iterator[ForkedProgram]:
    with simulated_rig(config, gadget.far_end) as process:
        yield process


@pytest.fixture
def camera(simulation: ForkedProgram, config: Path) -> Iterator[V4l2Camera]:
    assert simulation.process.is_alive()
    opened = V4l2Camera(load_config(config).camera)
    yield opened
    opened.close()


def opened_output(
    fourcc: str, side_px: int, bytes_per_line: int, device: str = VIDEO
) -> V4l2Output:
    return V4l2Output(
        device,
        fourcc=fourcc,
        width_px=side_px,
        height_px=side_px,
        bytes_per_line=bytes_per_line,
        period_s=PERIOD_S,
    )


# v4l2loopback has no formats Y10 and Y12, see below.
@pytest.mark.parametrize("name", ["GREY", "Y16", "YUYV", "UYVY"])
def test_pixels_and_stamps_arrive_as_they_were_written(name: str, tmp_path: Path) -> None:
    entry = PIXEL_FORMATS[name]
    assert entry.to_bytes is not None
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(name))
    written = np.random.default_rng(1).integers(
        0, 2**entry.bit_depth, (SIDE_PX, SIDE_PX), dtype=np.uint16
    )
    with (
        closing(opened_output(entry.fourcc, SIDE_PX, SIDE_PX * entry.bytes_per_px)) as output,
        closing(V4l2Camera(load_config(path).camera)) as reader,
    ):
        end_s = round(time.monotonic(), 6)
        output.write(entry.to_bytes(written), end_s)
        frame = reader.read(2.0)
    assert frame.bit_depth == entry.bit_depth
    assert frame.exposure_end_s + 0.004 == pytest.approx(end_s, abs=2e-6)
    if name in ("YUYV", "UYVY"):
        # Luma has 220 steps; values near its white count as saturated.
        good = frame.pixels < 255
        assert good.mean() > 0.9
        np.testing.assert_allclose(frame.pixels[good], 16 + written[good] * (219 / 255), atol=0.51)
    else:
        np.testing.assert_array_equal(frame.pixels, written)


@pytest.mark.parametrize("name", ["Y10", "Y12"])
def test_a_format_that_the_driver_does_not_have_is_named(name: str) -> None:
    with pytest.raises(CameraError, match=rf"{name} 64x64 .* not 128; .*Y16"):
        opened_output(PIXEL_FORMATS[name].fourcc, 64, 128)


def test_sets_are_captured_through_real_devices_also_after_a_kill(
    simulation: ForkedProgram, config: Path
) -> None:
    def capture(count: int, name: str) -> ForkedProgram:
        return ForkedProgram(
            "capture", "--rig", config, "--count", count, SHARED / f"{name}.ome.tif"
        )

    killed = capture(99, "killed")
    wait_for(lambda: list(SHARED.glob("killed-*.ome.tif")) or not killed.process.is_alive())
    assert killed.process.is_alive(), killed.end()
    killed.process.kill()
    killed.end()
    # The next program puts the LED out, and the camera is free again.
    assert capture(SETS, "part").end() == (0, "")
    assert len(list(SHARED.glob("part-*.ome.tif"))) == SETS
    assert simulation.process.is_alive()


def test_exposures_start_whole_periods_apart(camera: V4l2Camera) -> None:
    frames = [camera.read(3.0) for _ in range(10)]
    starts = np.diff([frame.exposure_start_s for frame in frames])
    numbers = np.diff([frame.sequence for frame in frames])
    assert (numbers >= 1).all()
    np.testing.assert_allclose(starts, numbers * PERIOD_S, atol=5e-6)


def test_a_stopped_simulation_sends_no_burst_when_it_continues(
    simulation: ForkedProgram, camera: V4l2Camera
) -> None:
    camera.read(3.0)
    os.kill(simulation.process.pid, signal.SIGSTOP)
    stopped_s = time.monotonic()
    time.sleep(8 * PERIOD_S)
    continued_s = time.monotonic()
    os.kill(simulation.process.pid, signal.SIGCONT)
    starts = [camera.read(3.0).exposure_start_s for _ in range(5)]
    # One frame may have been on its way into the device.
    assert [s for s in starts if stopped_s + PERIOD_S < s < continued_s - 2 * PERIOD_S] == []
    assert starts[-1] > continued_s


def test_stale_frames_are_dark_and_recognised_by_their_stamps(camera: V4l2Camera) -> None:
    with LightController(port_of(GADGET)) as lights:
        lights.off()
        dark = camera.read(3.0).pixels.mean()
        # Long enough to fill the device with dark frames.
        time.sleep(4 * PERIOD_S)
        before_s = time.monotonic()
        lit_s = lights.select(2).acknowledged_s + 0.02
        frames = [camera.read(3.0) for _ in range(6)]
    stale = [f.pixels.mean() for f in frames if f.exposure_end_s < before_s]
    fresh = [f.pixels.mean() for f in frames if f.exposure_start_s >= lit_s]
    assert len(stale) >= 1
    np.testing.assert_allclose(stale, dark, rtol=0.05)
    assert len(fresh) >= 2
    assert min(fresh) > 3.0 * dark


@pytest.mark.usefixtures("simulation")
def test_a_second_simulation_is_refused(gadget: Gadget) -> None:
    clock = RealClock()
    with pytest.raises(BlockingIOError):
        serve_tty(SimulatedController(SimulatedBoard(clock), clock), gadget.far_end)
    with pytest.raises(CameraError, match="another simulated rig"):
        opened_output("Y16 ", SIDE_PX, 2 * SIDE_PX)


def test_a_device_that_takes_no_frames_is_named() -> None:
    with pytest.raises(CameraError, match="is no video device"):
        opened_output("GREY", 64, 64, "/dev/null")


def test_ctrl_c_ends_it_with_a_count_of_its_frames(simulation: ForkedProgram) -> None:
    # The checks above need the process, and those below the devices.
    os.kill(simulation.process.pid, signal.SIGINT)
    status, errors = simulation.end()
    assert status == 0
    assert re.fullmatch(r"no LED lit, \d+ frames written, \d+ too late\n", errors)


def test_dark_frames_are_measured_through_real_devices(gadget: Gadget, config: Path) -> None:
    covered = SHARED / "covered.toml"
    covered.write_text(f"{rig_toml()}\n[simulation]\nhot_pixels = {HOT_PIXELS}\n")
    with simulated_rig(covered, gadget.far_end, "lens_cap") as simulation:
        calibrate = ("calibrate", "dark", "--rig", config, "--yes", SHARED / "rig.ps4cal")
        status, errors = ForkedProgram(*calibrate).end()
        assert status == 0, errors
        assert simulation.process.is_alive()
