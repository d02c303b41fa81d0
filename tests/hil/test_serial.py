"""The light controller over the kernel's serial drivers: an FTDI adapter and a CDC device."""

import threading
from pathlib import Path

import pytest

from firmware_sim import RealClock, Server, SimulatedBoard, SimulatedController, serve_unix

from .checks import GUEST, Outcomes, assert_passed, compile_for_guest, names_in, run_checks

pytestmark = pytest.mark.kernel

CHECKS = GUEST / "serial_checks.py"
CONTRACT = Path(__file__).parents[1] / "contract" / "test_lights_contract.py"
MODULES = ("xhci_pci", "ftdi_sio", "dummy_hcd", "usb_f_acm", "cdc_acm")
PORTS = ("ftdi_sio", "cdc_acm")


class HostController:
    """The firmware on a unix socket of the host; the guest unplugs and plugs it by making files."""

    def __init__(self, shared: Path) -> None:
        self._shared = shared
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._served = self._serve()
        self._thread.start()

    @property
    def adapter(self) -> list[str]:
        """QEMU options of the adapter for this line; it is unplugged while nobody listens."""
        line = f"socket,id=host,path={self._shared}/host.sock,reconnect=1"
        return ["-chardev", line, "-device", "usb-serial,chardev=host,serial=HOST-1"]

    def stop(self) -> None:
        self._ended.set()
        self._thread.join()
        self._served.stop()

    def _serve(self) -> Server:
        clock = RealClock()
        board = SimulatedBoard(clock, serial_number="HOST-1")
        return serve_unix(SimulatedController(board, clock), self._shared / "host.sock")

    def _run(self) -> None:
        while not self._ended.wait(0.05):
            if (self._shared / "pull").exists():
                (self._shared / "pull").unlink()
                self._served.stop()
            if (self._shared / "plug").exists():
                (self._shared / "plug").unlink()
                self._served = self._serve()


def _null_modem(folder: Path) -> list[str]:
    """An FTDI adapter whose line ends at the guest's second serial port."""
    line = folder / "modem.sock"
    return [
        *("-chardev", f"socket,id=far,path={line},server=on,wait=off", "-serial", "chardev:far"),
        *("-chardev", f"socket,id=near,path={line}", "-device", "qemu-xhci"),
        *("-device", "usb-serial,chardev=near,serial=MODEM-1"),
    ]


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> Outcomes:
    shared = tmp_path_factory.mktemp("serial")
    environment = compile_for_guest(shared, "--size", 48)
    host = HostController(shared)
    try:
        return run_checks(
            CHECKS,
            shared,
            modules=dict.fromkeys(MODULES, ""),
            devices=[*_null_modem(shared), *host.adapter],
            environment=environment,
        )
    finally:
        host.stop()


@pytest.mark.parametrize("port", PORTS)
@pytest.mark.parametrize("name", names_in(CONTRACT))
def test_the_contract_holds_over(outcomes: Outcomes, name: str, port: str) -> None:
    assert_passed(outcomes, f"{name}[{port}]")


@pytest.mark.parametrize("name", sorted({*names_in(CHECKS)} - {*names_in(CONTRACT)}))
def test_over_serial_drivers(outcomes: Outcomes, name: str) -> None:
    assert_passed(outcomes, name)
