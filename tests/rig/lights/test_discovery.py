"""Finding the controller: the real firmware on ptys that are listed as USB ports."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from rig import ConfigError, LightControllerError, RigConfig
from rig.config.lights import LightsConfig
from rig.lights.discovery import (
    SerialPort,
    find_controller,
    identify,
    known_port,
    list_serial_ports,
    list_serial_ports_if_possible,
    ports_to_try,
)
from rig.lights.driver import LightController
from rig.lights.link import ControllerIdentity, LinkTimeouts
from rig.lights.serial_line import _PortHolder, port_holders

PICO, UNKNOWN = "2e8a:0005", "1234:5678"


@pytest.fixture
def plug_in(served_port: Callable[[str], str]) -> Callable[..., SerialPort]:
    """Plug in a controller with a serial number and properties of its USB port."""

    def listed(own: str, usb_id: str | None = PICO, serial: str | None = None) -> SerialPort:
        return SerialPort(served_port(own), usb_id, serial)

    return listed


@pytest.fixture
def silent_port() -> Iterator[tuple[int, SerialPort]]:
    """A silent port: the descriptor of its other end, and its listing."""
    master, slave = os.openpty()
    os.set_blocking(master, False)
    port = SerialPort(os.ttyname(slave), PICO)
    os.close(slave)
    yield master, port
    os.close(master)


def auto(**keys: object) -> LightsConfig:
    return LightsConfig(port="auto", **keys)  # type: ignore[arg-type]


def never_asked(device: str, _baud: int) -> ControllerIdentity:
    raise AssertionError(f"{device} was asked for its identity")


def test_the_only_board_is_chosen_without_asking_it() -> None:
    ports = [SerialPort("/dev/ttyS0"), SerialPort("/dev/ttyACM3", PICO)]
    assert find_controller(auto(), ports, never_asked) == "/dev/ttyACM3"


def test_a_usb_serial_number_decides_first() -> None:
    ports = [SerialPort("/dev/ttyACM0", PICO, "A1"), SerialPort("/dev/ttyUSB1", UNKNOWN, "b2")]
    assert find_controller(auto(serial_number="B2"), ports, never_asked) == "/dev/ttyUSB1"
    assert find_controller(auto(serial_number="a1"), ports, never_asked) == "/dev/ttyACM0"


def test_a_usb_id_selects_ports_of_unknown_vendors_too() -> None:
    ports = [SerialPort("/dev/ttyACM0", PICO), SerialPort("/dev/ttyUSB1", UNKNOWN)]
    assert find_controller(auto(usb_id="1234:5678"), ports, never_asked) == "/dev/ttyUSB1"
    assert find_controller(auto(usb_id="2E8A:0005"), ports, never_asked) == "/dev/ttyACM0"


def test_the_controller_that_answers_is_chosen_among_several_ports(
    plug_in: Callable[..., SerialPort], silent_port: tuple[int, SerialPort]
) -> None:
    master, silent = silent_port
    there = plug_in("A-1")
    ask = partial(identify, timeouts=LinkTimeouts(open_s=0.3))
    assert find_controller(auto(), [silent, there], ask) == there.device
    lines = [line for line in os.read(master, 4096).split(b"\n") if line]
    assert lines  # and nothing but *IDN? was written to the other port
    assert all(line.startswith(b"#") and b" *IDN?~" in line for line in lines)


def test_the_controllers_own_serial_number_selects_it(plug_in: Callable[..., SerialPort]) -> None:
    ports = [plug_in("A-1"), plug_in("B-2")]
    assert find_controller(auto(serial_number="B-2"), ports) == ports[1].device
    with pytest.raises(LightControllerError, match=r"C-3 .*controller A-1"):
        find_controller(auto(serial_number="C-3"), ports)


def test_ports_are_asked_at_the_configured_speed() -> None:
    asked: list[tuple[str, int]] = []

    def silent(device: str, baud: int) -> ControllerIdentity:
        asked.append((device, baud))
        raise LightControllerError(f"{device}: no answer")

    ports = [SerialPort("/dev/ttyUSB0", PICO), SerialPort("/dev/ttyUSB1", PICO)]
    with pytest.raises(LightControllerError, match="no light controller"):
        find_controller(auto(baud=9600), ports, silent)
    assert asked == [("/dev/ttyUSB0", 9600), ("/dev/ttyUSB1", 9600)]


def test_several_controllers_are_an_error_that_names_them_and_the_key(
    plug_in: Callable[..., SerialPort],
) -> None:
    ports = [plug_in("A-1"), plug_in("B-2")]
    with pytest.raises(LightControllerError) as raised:
        find_controller(auto(), ports)
    message = str(raised.value)
    assert all(text in message for text in (ports[0].device, ports[1].device, "A-1", "B-2"))
    assert 'lights.serial_number, such as "A-1"' in message
    twins = [plug_in("SAME"), plug_in("SAME")]
    with pytest.raises(LightControllerError, match=r"set lights\.port"):
        find_controller(auto(usb_id=PICO), twins)


@pytest.mark.parametrize(
    ("ports", "message"),
    [
        ([], "no serial ports"),
        ([SerialPort("/dev/ttyS0")], "no light controller .*/dev/ttyS0"),
        ([SerialPort("/dev/ttyUSB0", UNKNOWN, "7")], "1234:5678, serial number 7"),
    ],
)
def test_no_controller_is_an_error(ports: list[SerialPort], message: str) -> None:
    with pytest.raises(LightControllerError, match=message):
        find_controller(auto(), ports, never_asked)
    with pytest.raises(LightControllerError, match="number X and USB id 2e8a:0005"):
        find_controller(auto(serial_number="X", usb_id=PICO), ports, never_asked)


_HOLDS = (
    "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print(1, flush=True); input()"
)


@pytest.fixture
def held() -> Iterator[Callable[[str], int]]:
    """Let another program open a device; return its process id."""
    programs: list[subprocess.Popen[bytes]] = []

    def hold(device: str) -> int:
        program = subprocess.Popen(
            [sys.executable, "-c", _HOLDS, device], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        programs.append(program)
        assert program.stdout is not None
        assert program.stdout.readline() == b"1\n"
        return program.pid

    yield hold
    for program in programs:
        program.communicate(b"\n")


def test_a_port_that_another_program_holds_is_not_written_to(
    silent_port: tuple[int, SerialPort], held: Callable[[str], int]
) -> None:
    master, port = silent_port
    os.set_blocking(master, False)
    pid = held(port.device)
    assert [holder.pid for holder in port_holders(port.device)] == [pid]
    with pytest.raises(LightControllerError, match=r"in use by .*process \d+"):
        identify(port.device)
    with pytest.raises(BlockingIOError):
        os.read(master, 1)
    assert ports_to_try(SerialPort("/dev/ttyACM9", PICO), [port]) == ["/dev/ttyACM9"]


_LOCKS = """
import sys
sys.path[:] = {path!r}
from rig.lights.driver import LightController
with LightController({port!r}):
    print(1, flush=True)
    input()
"""


def test_the_error_of_a_second_opener_names_the_first(bench: object) -> None:
    port = bench.port  # type: ignore[attr-defined]
    script = _LOCKS.format(path=sys.path, port=port)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", script], **pipes) as program:  # type: ignore[call-overload]
        assert program.stdout.readline() == b"1\n"
        with pytest.raises(LightControllerError, match=rf"in use by \S+ .process {program.pid}"):
            LightController(port)
        program.communicate(b"\n")


def test_a_port_opened_without_a_lock_is_refused(
    plug_in: Callable[..., SerialPort], held: Callable[[str], int]
) -> None:
    port = plug_in("A-1").device
    pid = held(port)
    with pytest.raises(LightControllerError, match=rf"in use by .* .process {pid}.; close that"):
        LightController(port)


def test_a_port_that_another_program_looks_at_for_a_moment_is_opened(
    bench: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    holders = iter([[_PortHolder(1, "probe")], []])
    monkeypatch.setattr("rig.lights.serial_line.port_holders", lambda _: next(holders))
    with LightController(bench.port) as lights:  # type: ignore[attr-defined]
        assert lights.select(1).led == 1


def test_ports_that_cannot_be_listed_are_an_error_and_not_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails() -> None:
        raise PermissionError(13, "Permission denied", "/sys/class/tty")

    monkeypatch.setattr("serial.tools.list_ports.comports", fails)
    with pytest.raises(LightControllerError, match=r"cannot be listed .*/sys/class/tty"):
        list_serial_ports()
    assert list_serial_ports_if_possible() == []


def test_holders_are_found_through_links_until_they_end(
    tmp_path: Path, held: Callable[[str], int]
) -> None:
    file, link = tmp_path / "port", tmp_path / "by-id"
    file.touch()
    link.symlink_to(file)
    assert port_holders(str(link)) == []
    pid = held(str(file))
    (holder,) = port_holders(str(link))
    assert holder.pid == pid
    assert str(holder) == f"{holder.name} (process {pid})"
    assert holder.name.startswith("python")


@pytest.mark.slow
def test_a_terminal_of_a_container_with_the_same_name_is_another_one(
    silent_port: tuple[int, SerialPort],
) -> None:
    device = silent_port[1].device
    opening = (
        "import os, sys\n"
        "while os.ttyname(os.openpty()[1]) != sys.argv[1]: pass\n"
        "print('open', flush=True)\n"
        "sys.stdin.read()\n"
    )
    own = "mount -t devpts -o newinstance,ptmxmode=0666 devpts /dev/pts"
    steps = f'{own} && mount --bind /dev/pts/ptmx /dev/ptmx && exec "$@"'
    container = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", steps, "sh"]
    with subprocess.Popen(
        [*container, sys.executable, "-c", opening, device],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as holder:  # fmt: skip
        assert holder.stdout is not None
        assert holder.stdout.readline() == "open\n"
        assert port_holders(device) == []
        holder.communicate()


def test_there_are_no_holders_without_proc(tmp_path: Path) -> None:
    assert port_holders("/dev/null", tmp_path / "none") == []
    (tmp_path / "12").mkdir()
    assert port_holders("/dev/null", tmp_path) == []


def test_a_lost_controller_is_searched_on_ports_of_the_same_usb_device(
    plug_in: Callable[..., SerialPort],
) -> None:
    here, there, twin = plug_in("A-1"), plug_in("B-2"), plug_in("A-1", serial="E66")
    lost = SerialPort("/dev/ttyACM9", PICO, "E66")
    assert ports_to_try(lost, [here, there, twin]) == [lost.device, twin.device]
    assert ports_to_try(here, [here, there, twin]) == [here.device, there.device]
    assert ports_to_try(SerialPort("/dev/mine"), [SerialPort("/dev/ttyS0")]) == ["/dev/mine"]


def test_a_port_is_found_by_any_of_its_names(tmp_path: Path) -> None:
    device, link = tmp_path / "ttyACM0", tmp_path / "by-id"
    device.touch()
    link.symlink_to(device)
    listed = SerialPort(str(device), PICO, "E66")
    assert known_port(str(link), [listed]) == SerialPort(str(link), PICO, "E66")
    assert known_port("socket://127.0.0.1:7", [listed]) == SerialPort("socket://127.0.0.1:7")
    assert ports_to_try(known_port(str(link), [listed]), [listed]) == [str(link)]


def test_ports_are_listed_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    class Info:
        def __init__(self, device: str, vid: int | None, serial_number: str | None) -> None:
            self.device, self.vid, self.pid = device, vid, 5
            self.serial_number, self.description = serial_number, "Board in FS mode"

    infos = [Info("/dev/ttyUSB9", 0x0403, ""), Info("/dev/ttyS4", None, None)]
    assert isinstance(list_serial_ports(), list)  # the ports of this machine
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: infos)
    assert list_serial_ports() == [
        SerialPort("/dev/ttyS4", None, None, "Board in FS mode"),
        SerialPort("/dev/ttyUSB9", "0403:0005", None, "Board in FS mode"),
    ]
    assert str(list_serial_ports()[1]) == "/dev/ttyUSB9 (0403:0005)"
    assert not list_serial_ports()[0].may_be_a_microcontroller


def test_a_key_of_the_search_is_refused_without_it() -> None:
    lights = {"port": "/dev/ttyACM0", "serial_number": "1"}
    with pytest.raises(ConfigError, match="are for port = 'auto'"):
        RigConfig().with_changes(lights=lights, camera={"kind": "v4l2", "device": "x"})
