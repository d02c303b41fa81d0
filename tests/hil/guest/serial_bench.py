"""Serial lines of the guest with the controller's firmware at their far ends."""

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from firmware_sim import Clock, RealClock, SimulatedBoard, SimulatedController, serve_tty
from rig import LightControllerError
from rig.config.lights import LightsConfig
from rig.lights.discovery import find_controller, known_port, list_serial_ports, ports_to_try
from rig.lights.driver import LightController
from tests.led_outputs import settled_outputs

T = TypeVar("T")

# The far end of the null modem, and the serial number of the adapter at its near end.
MODEM_FAR_END = "/dev/ttyS1"
MODEM = "MODEM-1"
# Serial number of an adapter at whose far end the host serves the firmware.
HOST = "HOST-1"
GADGET = "PICO-1"
# Files that make the host unplug and plug that adapter.
PULL, PLUG = Path("/mnt/pull"), Path("/mnt/plug")
_CONFIGFS = Path("/sys/kernel/config")
_TIMEOUT_S = 20.0


def port_of(serial_number: str) -> str:
    """Wait for the adapter with a serial number and return its port."""
    lights = LightsConfig(port="auto", serial_number=serial_number)

    def port() -> str:
        with suppress(LightControllerError):
            return find_controller(lights, list_serial_ports())
        return ""

    return wait_for(port)


def wait_for(find: Callable[[], T]) -> T:
    """Call `find` until it returns a true value, and return that."""
    deadline_s = time.monotonic() + _TIMEOUT_S
    while time.monotonic() < deadline_s:
        if value := find():
            return value
        time.sleep(0.02)
    raise AssertionError(f"still nothing after {_TIMEOUT_S:g} s")


class Gadget:
    """A USB device with one CDC serial line, plugged into this same machine.

    Its end of the line is ``/dev/ttyGS0``, the host's end ``/dev/ttyACM0``.
    """

    far_end = "/dev/ttyGS0"

    def __init__(self, serial_number: str) -> None:
        if not (_CONFIGFS / "usb_gadget").exists():
            subprocess.run(["mount", "-t", "configfs", "none", _CONFIGFS], check=True)
        self.serial_number = serial_number
        self._folder = _CONFIGFS / "usb_gadget" / serial_number
        texts, config = self._folder / "strings/0x409", self._folder / "configs/c.1"
        for folder in (texts, config, self._folder / "functions/acm.0"):
            folder.mkdir(parents=True)
        # The ids of a Raspberry Pi Pico with MicroPython.
        (self._folder / "idVendor").write_text("0x2e8a")
        (self._folder / "idProduct").write_text("0x0005")
        (texts / "manufacturer").write_text("ps4rig")
        (texts / "product").write_text("LED controller")
        (texts / "serialnumber").write_text(serial_number)
        (config / "acm.0").symlink_to(self._folder / "functions/acm.0")
        self.plug()

    def plug(self) -> None:
        controller = next(Path("/sys/class/udc").iterdir()).name
        (self._folder / "UDC").write_text(controller)

    def unplug(self) -> None:
        (self._folder / "UDC").write_text("\n")

    @property
    def is_plugged(self) -> bool:
        return bool((self._folder / "UDC").read_text().strip())


@dataclass(frozen=True)
class Plug:
    """The controller's end of a line; stopping it unplugs it and cuts its power."""

    pull: Callable[[], None]

    def stop(self) -> None:
        self.pull()


@dataclass(frozen=True)
class SerialController:
    """The firmware at the far end of a serial line, and the light of its LEDs."""

    port: str
    clock: Clock
    board: SimulatedBoard
    server: Plug

    def open(self, **options: int) -> LightController:
        known = known_port(self.port, list_serial_ports())
        return LightController(
            self.port,
            clock=self.clock,
            possible_ports=lambda: ports_to_try(known, list_serial_ports()),
            **options,
        )

    def lit(self) -> list[int]:
        return [led for led, share in enumerate(settled_outputs(self.clock, self.board)) if share]


@contextmanager
def controller_at(
    far_end: str, port: str, unplug: Callable[[], None] = lambda: None
) -> Iterator[SerialController]:
    """Serve the firmware at one end of a line whose other end is `port`."""
    clock = RealClock()
    board = SimulatedBoard(clock)
    with serve_tty(SimulatedController(board, clock, boot_ms=100.0), far_end) as server:

        def pull() -> None:
            unplug()
            server.stop()

        yield SerialController(port, clock, board, Plug(pull))
