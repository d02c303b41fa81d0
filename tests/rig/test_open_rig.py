"""Opening and closing a rig."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from classify.base.errors import InputError
from firmware_sim import SimulatedBoard, SimulatedController, VirtualClock, serve_pty, serve_tcp
from rig import (
    ConfigError,
    Placement,
    Rig,
    RigConfig,
    open_rig,
    surface_names,
)
from rig.lights.driver import LightController
from rig.scene.material_folder import bundled_materials
from tests.led_outputs import settled_outputs

SMALL = RigConfig().with_changes(camera={"width_px": 64, "height_px": 48})


@pytest.fixture
def rig() -> Iterator[Rig]:
    with open_rig(SMALL) as opened:
        yield opened


def outputs(rig: Rig) -> list[float]:
    assert rig.simulation is not None
    return settled_outputs(rig.clock, rig.simulation.board)


def test_sim_is_the_simulated_rig() -> None:
    with open_rig("sim") as rig:
        assert rig.config == RigConfig()
        assert rig.simulation is not None
        assert rig.lights.port.startswith("socket://127.0.0.1:")
        assert rig.lighting == rig.config.lights.lighting
        assert (rig.camera.info.width_px, rig.camera.info.bit_depth) == (512, 12)


def test_a_path_to_a_file_called_sim_is_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such rig configuration"):
        open_rig(tmp_path / "sim")


def test_leaving_the_block_puts_the_leds_out() -> None:
    threads = threading.active_count()
    with open_rig(SMALL) as rig:
        rig.lights.select(2)
        assert outputs(rig) == [0.0, 0.0, 1.0, 0.0]
    assert outputs(rig) == [0.0] * 4
    rig.close()
    assert threading.active_count() == threads


def test_an_interrupt_while_the_lights_are_closed_still_closes_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    threads = threading.active_count()
    rig = open_rig(SMALL)

    def interrupted() -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(rig.lights, "off", interrupted)
        with pytest.raises(KeyboardInterrupt):
            rig.close()
    assert outputs(rig) == [0.0] * 4
    assert threading.active_count() == threads


def test_an_unknown_surface_is_refused_and_changes_nothing(rig: Rig) -> None:
    assert rig.simulation is not None
    before = rig.simulation.placement
    with pytest.raises(InputError, match="neither a material folder"):
        rig.simulation.place(Placement(surface="no such surface"))
    assert rig.simulation.placement == before
    assert rig.camera.read(1.0).pixels.shape == (48, 64)


def test_surface_names_lists_synthetic_and_bundled_surfaces() -> None:
    names = surface_names()
    assert names[:4] == ("rock", "sand", "malv", "ogil")
    assert set(names[4:]) == set(bundled_materials())
    assert len(names) >= 12


def test_a_rig_may_have_more_than_four_leds() -> None:
    tilts = [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0]
    with open_rig(SMALL.with_changes(lights={"tilts_deg": tilts})) as rig:
        assert rig.lights.led_count == len(rig.lighting) == 8
        assert rig.lights.select(7).led == 7


@pytest.mark.parametrize("serve", [serve_pty, serve_tcp])
def test_a_simulated_camera_is_refused_above_a_real_controller(serve: type) -> None:
    clock = VirtualClock()
    with serve(SimulatedController(SimulatedBoard(clock), clock)) as server:
        config = SMALL.with_changes(lights={"port": server.address})
        with pytest.raises(ConfigError, match=r"camera needs lights\.port"):
            open_rig(config)


def test_a_controller_with_too_few_leds_is_refused() -> None:
    clock = VirtualClock()
    with serve_pty(SimulatedController(SimulatedBoard(clock, led_count=2), clock)) as server:
        config = SMALL.with_changes(lights={"port": server.address})
        with pytest.raises(ConfigError, match=r"4 LEDs, .* has 2"):
            open_rig(config)


def test_a_refused_rig_leaves_no_thread_running() -> None:
    before = set(threading.enumerate())
    config = RigConfig().with_changes(
        camera={"timing_measured_at": "another mode", "timestamp_offset_ms": 1.0}
    )
    with pytest.raises(ConfigError, match="ps4rig rig latency"):
        open_rig(config)
    assert set(threading.enumerate()) == before


@pytest.mark.parametrize(("serial_number", "is_simulated"), [("SIM-0007", True), ("E66-1", False)])
def test_a_rig_of_devices_is_simulated_if_its_controller_says_so(
    rig: Rig, serial_number: str, is_simulated: bool
) -> None:
    """`ps4rig rig simulate` answers behind a serial device and a video device."""
    assert rig.is_simulated
    clock = VirtualClock()
    board = SimulatedBoard(clock, serial_number=serial_number)
    with (
        serve_pty(SimulatedController(board, clock)) as server,
        LightController(server.address, clock=clock) as lights,
    ):
        assert replace(rig, lights=lights, simulation=None).is_simulated == is_simulated
