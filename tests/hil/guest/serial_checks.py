"""The light controller over the kernel's serial drivers. Runs as root in the guest.

``ftdi_sio`` drives two adapters: the line of one ends at the guest's second serial port, the line
of the other at the firmware on the host. ``cdc_acm`` drives a USB gadget.
"""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from capture import SetRejected, capture_set
from rig import HardwareError, LightControllerError, Rig, RigConfig
from rig.config.lights import LightsConfig
from rig.lights.discovery import find_controller, known_port, list_serial_ports, ports_to_try
from rig.lights.driver import LightController
from rig.lights.serial_line import port_holders
from rig.scene.render import SceneImages
from rig.simulation.camera import FreeRunning, Shutter, SimulatedCamera
from rig.simulation.sensor import SensorModel
from tests.contract.test_lights_contract import (  # noqa: F401
    test_an_impossible_request_is_refused_and_changes_nothing,
    test_an_unplugged_controller_is_an_error_and_dark,
    test_close_puts_the_leds_out_and_the_next_program_can_open_it,
    test_confirm_fails_when_another_led_is_lit,
    test_controller_times_increase,
    test_each_led_keeps_its_level,
    test_it_identifies_itself,
    test_one_led_at_a_time_in_any_order,
    test_the_light_changes_before_the_acknowledge,
    test_the_watchdog_puts_the_leds_out_when_the_host_is_silent,
)
from tests.hil.guest.serial_bench import (
    GADGET,
    HOST,
    MODEM,
    MODEM_FAR_END,
    PLUG,
    PULL,
    Gadget,
    SerialController,
    controller_at,
    port_of,
    wait_for,
)

PORTS = {"ftdi_sio": (MODEM, MODEM_FAR_END), "cdc_acm": (GADGET, Gadget.far_end)}


@pytest.fixture(scope="module")
def gadget() -> Gadget:
    return Gadget(GADGET)


@pytest.fixture(params=PORTS)
def controller(request: pytest.FixtureRequest, gadget: Gadget) -> Iterator[SerialController]:
    serial_number, far_end = PORTS[request.param]
    port = port_of(serial_number)
    if request.param == "ftdi_sio":
        with controller_at(far_end, port) as served:
            yield served
        return
    with controller_at(far_end, port, gadget.unplug) as served:
        yield served
    if not gadget.is_plugged:
        gadget.plug()


@pytest.fixture
def gadget_controller(gadget: Gadget) -> Iterator[SerialController]:
    with controller_at(gadget.far_end, port_of(GADGET)) as served:
        yield served


def rig_with(lights: LightController, controller: SerialController) -> Rig:
    """A rig with a serial light controller and a simulated camera that sees the board's LEDs."""
    config = RigConfig().with_changes(
        camera={"width_px": 48, "height_px": 32, "frame_rate_hz": 10.0, "exposure_ms": 20.0},
        lights={"settle_ms": 20.0},
    )
    camera = SimulatedCamera(
        controller.board,
        controller.clock,
        _card(32, 48),
        SensorModel(bit_depth=12),
        FreeRunning(controller.clock, Shutter(0.1, 0.02)),
        seed=1,
    )
    return Rig(config, controller.clock, lights, camera, None)


def _card(rows: int, columns: int) -> SceneImages:
    """A plain grey card."""
    grey = np.full((rows, columns), 0.5, np.float32)
    lights = np.stack([grey] * 4)
    flat = np.zeros_like(grey)
    return SceneImages(lights, 0.02 * grey, lights < 0, flat, flat, grey)


def test_a_port_in_use_is_named(controller: SerialController) -> None:
    with controller.open() as lights:
        lights.select(1)
        with pytest.raises(LightControllerError, match="in use by"):
            controller.open()
        lights.confirm(1)


def test_a_line_unplugged_in_mid_set_ends_it_and_the_next_one_is_good(
    gadget: Gadget, gadget_controller: SerialController
) -> None:
    def pull_at_the_second_light() -> None:
        wait_for(lambda: gadget_controller.board.output(1, gadget_controller.clock.now_s()) > 0.5)
        gadget.unplug()

    puller = threading.Thread(target=pull_at_the_second_light)
    puller.start()
    with rig_with(gadget_controller.open(watchdog_ms=1000), gadget_controller) as rig:
        with pytest.raises((HardwareError, SetRejected), match="gone"):
            capture_set(rig)
        puller.join()
        unplugged_s = time.monotonic()
        wait_for(lambda: gadget_controller.lit() == [])
        assert time.monotonic() - unplugged_s < 3.0
        gadget.plug()
        port_of(GADGET)
        captured = capture_set(rig)
    assert len(captured.images) == 4


def test_it_is_found_by_its_usb_description(gadget_controller: SerialController) -> None:
    ports = list_serial_ports()
    (listed,) = (port for port in ports if port.device == gadget_controller.port)
    assert (listed.usb_id, listed.serial_number) == ("2e8a:0005", GADGET)
    assert listed.may_be_a_microcontroller
    for keys in ({"serial_number": GADGET}, {"usb_id": "2E8A:0005"}):
        lights = LightsConfig.model_validate({"port": "auto", **keys})
        assert find_controller(lights, ports) == gadget_controller.port


def test_auto_finds_the_board_that_answers(gadget_controller: SerialController) -> None:
    # The adapter's vendor makes chips for boards; nobody answers behind this one.
    boards = [
        port
        for port in list_serial_ports()
        if port.may_be_a_microcontroller and port.serial_number != HOST
    ]
    assert len(boards) > 1
    assert find_controller(LightsConfig(port="auto"), boards) == gadget_controller.port


def test_recovery_finds_a_replugged_controller_under_another_name(
    gadget: Gadget, gadget_controller: SerialController
) -> None:
    known = known_port(gadget_controller.port, list_serial_ports())
    with LightController(
        gadget_controller.port,
        clock=gadget_controller.clock,
        possible_ports=lambda: ports_to_try(known, list_serial_ports()),
    ) as lights:
        lights.set_level(3, 40)
        lights.select(3)
        gadget.unplug()
        gadget.plug()
        again = port_of(GADGET)  # another name, because the old port is still open
        with pytest.raises(LightControllerError):
            lights.confirm(3)
        lights.recover()
        assert (lights.port, lights.port == known.device) == (again, False)
        assert lights.select(3).led == 3
        assert lights.state().levels_percent == (100, 100, 100, 40)


_HOLDS = "import sys, serial; line = serial.Serial(sys.argv[1]); print(1, flush=True); input()"


def test_the_program_that_holds_a_port_is_named(gadget_controller: SerialController) -> None:
    port = gadget_controller.port
    with subprocess.Popen(
        [sys.executable, "-c", _HOLDS, port], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout.readline() == b"1\n"
        assert [program.pid for program in port_holders(port)] == [holder.pid]
        with pytest.raises(LightControllerError, match=rf"process {holder.pid}.; close that first"):
            gadget_controller.open()
        holder.communicate(b"\n")
    with gadget_controller.open() as lights:
        assert lights.select(0).led == 0


def test_firmware_on_the_host_is_used_over_ftdi_sio_and_reconnects() -> None:
    with LightController(port_of(HOST)) as lights:
        assert lights.identity.serial_number == HOST
        for led in range(4):
            lights.select(led)
            lights.confirm(led)
        PULL.touch()
        with pytest.raises(LightControllerError, match="gone"):
            _confirm_for(10.0, lights)
    PLUG.touch()
    with LightController(port_of(HOST)) as lights:
        # It was reset, and its LEDs were out.
        assert lights.state().led is None


def _confirm_for(time_s: float, lights: LightController) -> None:
    deadline_s = time.monotonic() + time_s
    while time.monotonic() < deadline_s:
        lights.confirm(3)
