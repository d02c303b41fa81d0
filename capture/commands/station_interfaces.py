"""Interfaces of `ps4rig station run`: terminal, triggers, panel, PLC and MQTT."""

import os
import secrets
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING

from capture.base.console import complain, out
from capture.station.domain.config import StationConfig
from capture.station.domain.errors import CannotListen
from capture.station.domain.folder import StationFolder
from capture.station.domain.interface_config import ModbusConfig, MqttConfig, PanelConfig
from capture.station.line.handshake import MAX_SESSION, SOURCE, Handshake
from capture.station.line.line import PlcLine
from capture.station.run.events import Warned, text_lines
from capture.station.run.live_socket import serving_live
from capture.station.run.live_station import LiveStation, Subscriber
from capture.station.run.live_view import LiveEvent
from capture.station.run.triggers import (
    LineTrigger,
    NoTriggers,
    SensorTrigger,
    TimerTrigger,
    TriggerSource,
)
from capture.station.service.systemd import Journal, is_connected_to_journal
from classify.base.errors import InputError
from classify.base.models import validated

if TYPE_CHECKING:
    from capture.station.line.mqtt import MqttPublisher

_STDOUT = 1


@contextmanager
def running_interfaces(
    folder: StationFolder,
    live: LiveStation,
    trigger: str,
    subscribers: Sequence[Subscriber],
    *,
    panel: bool | None,
    host: str | None,
    port: int | None,
) -> Iterator[None]:
    """Serve panel, PLC and MQTT, and tell them and `subscribers` of events, while the block runs.

    `panel`, `host` and `port` are the options of the panel; None if not given.
    """
    config = folder.config
    with ExitStack() as stack:
        settings = panel_settings(config.panel, host, port)
        is_needed = panel
        if is_needed is None:
            is_needed = host is not None or port is not None or trigger == "http"
        with _warning_if_cannot_listen(is_needed=is_needed):
            # Also without a panel here, because a panel may be a systemd unit of its own.
            stack.enter_context(serving_live(folder, live))
            if panel is not False:
                stack.enter_context(_running_panel(folder, settings))
        line = plc_line(config, live, trigger)
        all_subscribers = [*subscribers] + ([] if line is None else [line.tell])
        if config.mqtt is not None:
            all_subscribers.append(stack.enter_context(mqtt_publisher(config.mqtt, folder)).tell)
        stack.enter_context(live.telling(*all_subscribers))
        if line is not None:
            stack.enter_context(serving_plc_line(line, config.modbus))
        yield


@contextmanager
def _warning_if_cannot_listen(*, is_needed: bool) -> Iterator[None]:
    """Turn `CannotListen`, as for a port in use, into a warning unless the panel `is_needed`."""
    try:
        yield
    except CannotListen as error:
        if is_needed:
            raise CannotListen(f"{error}; --no-panel runs without one") from error
        complain(f"warning: no panel: {error}")


@contextmanager
def _running_panel(folder: StationFolder, settings: PanelConfig) -> Iterator[None]:
    """Run the panel's process while the block runs, and print its address."""
    from capture.station.panel.process import panel_process
    from capture.station.panel.server import panel_address, panel_listener

    def warn(text: str) -> None:
        complain(f"warning: {text}")
        _log_text(folder, f"warning: {text}")

    listener = panel_listener(folder.path, settings)
    with panel_process(folder.path, settings, listener, warn):
        complain(f"panel: {panel_address(settings, listener)}")
        yield


def _log_text(folder: StationFolder, text: str) -> None:
    """Append a text to the log of a station, unless the disk is full."""
    with suppress(InputError):
        folder.log(text)


def panel_settings(configured: PanelConfig, host: str | None, port: int | None) -> PanelConfig:
    """Return the settings with the host and port of the command line, where given."""
    options = {key: value for key, value in (("host", host), ("port", port)) if value is not None}
    return validated(configured.model_dump() | options, PanelConfig, "--host, --port")


def plc_line(config: StationConfig, live: LiveStation, trigger: str) -> PlcLine | None:
    """Return the handshake with a PLC, or None if neither section nor trigger asks for one."""
    if config.modbus is None and trigger != SOURCE:
        return None
    handshake = Handshake(
        session=1 + secrets.randbelow(MAX_SESSION),
        plc_triggers=trigger == SOURCE,
        station=live.state,
        recipes=() if config.modbus is None else config.modbus.recipes,
    )
    return PlcLine(live, handshake)


@contextmanager
def serving_plc_line(line: PlcLine, configured: ModbusConfig | None) -> Iterator[None]:
    """Serve the registers of a line while the block runs, and print their address."""
    try:
        from capture.station.line.modbus import serving_modbus
    except ImportError as error:
        raise InputError(f"[modbus] needs {error.name}: pip install 'ps4rig[modbus]'") from error

    with serving_modbus(line, configured or ModbusConfig()) as address:
        complain(f"modbus: {address}")
        yield


def mqtt_publisher(settings: MqttConfig, folder: StationFolder) -> "MqttPublisher":
    """Return the publisher of results by MQTT; its messages go to the log of the station."""
    try:
        from capture.station.line.mqtt import MqttPublisher
    except ImportError as error:
        raise InputError(f"[mqtt] needs {error.name}: pip install 'ps4rig[mqtt]'") from error

    return MqttPublisher(settings, partial(_log_text, folder))


def terminal_subscriber(station: str, *, as_json: bool) -> Subscriber:
    """Return a subscriber that prints events, or writes the journal if stdout leads there."""
    if as_json:
        return _print_event_as_json
    if is_connected_to_journal(os.environ, _STDOUT):
        return Journal(station).tell
    return _print_event


def _print_event(live: LiveEvent) -> None:
    """Print an event for people; warnings go to stderr."""
    for line in text_lines(live.event):
        if isinstance(live.event, Warned):
            complain(line)
        else:
            out.print(line)


def _print_event_as_json(live: LiveEvent) -> None:
    """Print an event as one line of JSON, at once."""
    print(live.as_json, flush=True)


def _read_key_line() -> str:
    """Read a line from the keyboard; the program can end while it waits."""
    # Unbuffered: a thread that waits in a buffered reader would hold its lock at the end.
    with open(sys.stdin.fileno(), "rb", buffering=0, closefd=False) as keys:
        return keys.readline().decode(errors="replace")


def trigger_source(trigger: str, timer_s: float) -> TriggerSource:
    """Return where triggers come from."""
    match trigger:
        case "enter":
            return LineTrigger(_read_key_line)
        case "timer":
            return TimerTrigger(timer_s)
        case "sensor":
            return SensorTrigger()
        case _:
            return NoTriggers()
