"""The light controller over the kernel's serial drivers: an FTDI adapter and a CDC device."""

from pathlib import Path

import pytest

from .checks import GUEST, Outcomes, assert_passed, names_in, run_checks

pytestmark = pytest.mark.slow

CHECKS = GUEST / "serial_checks.py"
CONTRACT = Path(__file__).parents[1] / "contract" / "test_lights_contract.py"
MODULES = ("xhci_pci", "ftdi_sio", "dummy_hcd", "usb_f_acm", "cdc_acm")
PORTS = ("ftdi_sio", "cdc_acm")


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
    return run_checks(
        CHECKS, shared, modules=dict.fromkeys(MODULES, ""), devices=_null_modem(shared)
    )


@pytest.mark.parametrize("port", PORTS)
@pytest.mark.parametrize("name", names_in(CONTRACT))
def test_the_contract_holds_over(outcomes: Outcomes, name: str, port: str) -> None:
    assert_passed(outcomes, f"{name}[{port}]")


@pytest.mark.parametrize("name", sorted({*names_in(CHECKS)} - {*names_in(CONTRACT)}))
def test_over_serial_drivers(outcomes: Outcomes, name: str) -> None:
    assert_passed(outcomes, name)
