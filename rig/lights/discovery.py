"""Find the light controller by serial number, USB id, or asking ``*IDN?``; find it again."""

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from rig.config.lights import AUTO, LightsConfig
from rig.errors import LightControllerError

from .link import DEFAULT_TIMEOUTS, ControllerIdentity, ControllerLink, LinkTimeouts
from .serial_line import port_holders, pyserial

_BY_ID = Path("/dev/serial/by-id")
# USB vendors of microcontroller boards and of their USB chips. Devices of other vendors, such as
# modems, are not asked unless their USB id is configured.
_VENDORS = {
    "0403": "FTDI",
    "0483": "STMicroelectronics",
    "04d8": "Microchip",
    "067b": "Prolific",
    "10c4": "Silicon Labs",
    "16c0": "Teensy",
    "1a86": "WCH",
    "1b4f": "SparkFun",
    "1d6b": "Linux gadget",
    "1fc9": "NXP",
    "2341": "Arduino",
    "239a": "Adafruit",
    "2a03": "Arduino",
    "2e8a": "Raspberry Pi",
    "303a": "Espressif",
    "f055": "MicroPython",
}


@dataclass(frozen=True)
class SerialPort:
    """One serial port of this machine."""

    device: str  # the kernel's name, which depends on the order of plugging
    usb_id: str | None = None  # vendor and product, such as 2e8a:0005; None without USB
    serial_number: str | None = None
    description: str = ""
    by_id: str | None = None  # in /dev/serial/by-id

    @property
    def may_be_a_microcontroller(self) -> bool:
        """Whether its USB vendor makes boards or USB chips for boards."""
        return self.usb_id is not None and self.usb_id[:4] in _VENDORS

    def __str__(self) -> str:
        parts = (self.usb_id, self.serial_number and f"serial number {self.serial_number}")
        identity = ", ".join(filter(None, parts))
        return f"{self.device} ({identity})" if identity else self.device


_Ask = Callable[[str, int], ControllerIdentity]


def list_serial_ports() -> list[SerialPort]:
    """List the serial ports, sorted by name; none if nothing is plugged in."""
    pyserial()
    from serial.tools.list_ports import comports

    try:
        listed = list(comports())
    except (TypeError, ValueError, OSError) as error:  # a port was unplugged meanwhile
        raise LightControllerError(
            f"the serial ports cannot be listed ({error}); try again"
        ) from error
    names = {path.resolve(): str(path) for path in sorted(_BY_ID.glob("*"))}
    ports = [
        SerialPort(
            device=info.device,
            usb_id=None if info.vid is None else f"{info.vid:04x}:{info.pid:04x}",
            serial_number=info.serial_number or None,
            description="" if info.description in (None, "n/a") else info.description,
            by_id=names.get(Path(info.device).resolve()),
        )
        for info in listed
    ]
    return sorted(ports, key=lambda port: port.device)


def list_serial_ports_if_possible() -> list[SerialPort]:
    """List the serial ports, or none if that fails; for callers that know their port."""
    with suppress(LightControllerError):
        return list_serial_ports()
    return []


def identify(
    device: str, baud: int = 115_200, timeouts: LinkTimeouts = DEFAULT_TIMEOUTS
) -> ControllerIdentity:
    """Identify the controller at a port; only an empty line and ``*IDN?`` are written."""
    link = ControllerLink(device, baud, timeouts)
    link.close()
    return link.identity


def find_controller(lights: LightsConfig, ports: Sequence[SerialPort], ask: _Ask = identify) -> str:
    """Find the controller for ``lights.port = "auto"``, as rig/README.md describes."""
    serial_number = lights.serial_number
    # A serial number of USB selects among all ports; only boards of known makers are asked for one.
    if lights.usb_id is None:
        selected, candidates = ports, [port for port in ports if port.may_be_a_microcontroller]
    else:
        selected = candidates = [port for port in ports if port.usb_id == lights.usb_id]
    if serial_number is not None:
        numbered = [port for port in selected if _same_number(port.serial_number, serial_number)]
        if numbered:  # by USB: the controller need not be asked for its number
            candidates, serial_number = numbered, None
    if len(candidates) == 1 and serial_number is None:
        return candidates[0].device  # opening it identifies the controller
    answered: list[tuple[SerialPort, ControllerIdentity]] = []
    rejected: list[str] = []
    for port in candidates:
        try:
            identity = ask(port.device, lights.baud)
        except LightControllerError as error:
            rejected.append(str(error))
            continue
        if serial_number is None or _same_number(identity.serial_number, serial_number):
            answered.append((port, identity))
        else:
            rejected.append(f"{port.device}: light controller {identity.serial_number}")
    if len(answered) == 1:
        return answered[0][0].device
    if answered:
        raise LightControllerError(_ambiguity_text(answered))
    raise LightControllerError(_not_found_text(lights, ports, rejected))


def known_port(port: str, ports: Iterable[SerialPort]) -> SerialPort:
    """Find a port among `ports` by any of its names; an unlisted port gets only its name."""
    path = Path(port).resolve()
    same = (listed for listed in ports if Path(listed.device).resolve() == path)
    return replace(next(same, SerialPort(port)), device=port)


def ports_to_try(previous: SerialPort, ports: Iterable[SerialPort]) -> list[str]:
    """List the ports on which the controller of the port `previous` may be now."""
    others = [
        port.device
        for port in ports
        if port.usb_id is not None
        and (port.usb_id, port.serial_number) == (previous.usb_id, previous.serial_number)
        and Path(port.device).resolve() != Path(previous.device).resolve()
        and not port_holders(port.device)
    ]
    return [previous.device, *others]


def _same_number(number: str | None, other: str) -> bool:
    return number is not None and number.casefold() == other.casefold()


def _ambiguity_text(answered: Sequence[tuple[SerialPort, ControllerIdentity]]) -> str:
    listed = ", ".join(f"{port.device} ({identity.serial_number})" for port, identity in answered)
    numbers = {identity.serial_number.casefold() for _, identity in answered}
    if len(numbers) == len(answered):
        remedy = f'set lights.serial_number, such as "{answered[0][1].serial_number}"'
    else:
        first = answered[0][0]
        remedy = f'set lights.port to one of them, such as "{first.by_id or first.device}"'
    return f"{len(answered)} light controllers answer: {listed}; {remedy}"


def _not_found_text(
    lights: LightsConfig, ports: Sequence[SerialPort], rejected: Sequence[str]
) -> str:
    number, usb_id = lights.serial_number, lights.usb_id
    keys = (number and f"serial number {number}", usb_id and f"USB id {usb_id}")
    selection = " and ".join(filter(None, keys))
    controller = f"light controller with {selection}" if selection else "light controller"
    outcome = "; ".join(rejected) or ", ".join(map(str, ports)) or "there are no serial ports"
    return (
        f'lights.port = "{AUTO}": no {controller} was found ({outcome}); is it plugged in? Or set '
        "lights.port to its device"
    )


PossiblePorts = Callable[[], Iterable[str]]
"""The ports on which a controller may be now, the most likely one first."""

_PAUSE_S = 0.1  # between two rounds through the ports; short against the second that USB takes
_MIN_OPEN_S = 0.1  # for an attempt at the deadline; a controller answers within milliseconds


def find_again(
    identity: ControllerIdentity, possible_ports: PossiblePorts, baud: int, timeouts: LinkTimeouts
) -> ControllerLink:
    """Open the line to the controller with the same serial number, on any of the ports."""
    expected, deadline_s = identity.serial_number, time.monotonic() + timeouts.recover_s
    while True:
        failure: LightControllerError | None = None
        for port in possible_ports():
            open_s = max(_MIN_OPEN_S, deadline_s - time.monotonic())
            try:
                link = ControllerLink(port, baud, replace(timeouts, open_s=open_s))
            except LightControllerError as error:
                failure = failure or error
                continue
            present = link.identity.serial_number
            if present == expected:
                return link
            link.close()
            failure = LightControllerError(
                f"{port}: light controller {present} is there in place of {expected}; plug "
                f"{expected} in again, or open the rig again to use {present}"
            )
        if time.monotonic() >= deadline_s:
            raise failure or LightControllerError(
                f"light controller {expected} is not plugged in any more"
            )
        time.sleep(_PAUSE_S)
