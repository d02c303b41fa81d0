"""Modbus TCP by pymodbus: the station as a server, and a client as the PLC."""

import asyncio
import logging
import socket
import struct
import threading
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Self, cast

from pymodbus.client import ModbusTcpClient
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    ReadWriteMultipleRegistersRequest,
)
from pymodbus.server import ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from capture.station.domain.errors import error_text
from capture.station.domain.interface_config import ModbusConfig
from capture.station.domain.listening import listening_socket
from classify.base.errors import InputError

from .line import TICK_S, PlcLine
from .registers import PLC, PLC_ADDRESS, PLC_WORDS, STATION, STATION_WORDS, decoded, encoded

_log = logging.getLogger(__name__)
_READS, _WRITES = (3, 4, 23), (6, 16, 22, 23)  # function codes
# Enough for a PLC, its spare, a panel of the line and a few programs of engineers.
MAX_CONNECTIONS = 16
# Time of silence after which a client makes room for a new one. A PLC polls several times a second.
IDLE_S = 10.0
# Largest size of unread answers, about a hundred: a client with more of them does not read.
_MAX_UNREAD_BYTES = 16 * 1024
# A client that acknowledges nothing for this long does not read, or is gone. The bound on unread
# answers does not detect this: Linux can drop what arrives at a full client, with the
# acknowledgements of its own requests, so that neither side sends anything more.
_MAX_UNACKNOWLEDGED_MS = 10_000
_START_S = 60.0
# Errors in the requests of a client would fill the terminal.
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


class _WithCountCheck(ModbusPDU):
    """Answers a wrong count with exception 3; pymodbus would report an unknown function."""

    _is_wrong = False

    def verifyCount(self, *args: Any, **options: Any) -> None:  # noqa: N802 - of pymodbus
        try:
            super().verifyCount(*args, **options)
        except ValueError:
            self._is_wrong = True

    async def datastore_update(self, context: Any, device_id: int) -> ModbusPDU:
        if self._is_wrong:
            return ExceptionResponse(self.function_code, ExcCodes.ILLEGAL_VALUE)
        return await super().datastore_update(context, device_id)


class _ReadHolding(_WithCountCheck, ReadHoldingRegistersRequest):
    pass


class _ReadInput(_WithCountCheck, ReadInputRegistersRequest):
    pass


class _ReadWrite(_WithCountCheck, ReadWriteMultipleRegistersRequest):
    pass


class _Connection(ServerRequestHandler):
    """A client, which the server may refuse when its address is known."""

    def __init__(self, server: "_Server") -> None:
        super().__init__(server, None, None, None)
        self._admits = server.admits
        self.heard_s = time.monotonic()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if not self._admits(self):
            cast(asyncio.Transport, transport).abort()

    def callback_data(self, data: bytes, addr: tuple[Any, ...] | None = None) -> int:
        self.heard_s = time.monotonic()
        return super().callback_data(data, addr)


class _Server(ModbusTcpServer):
    """The registers of a line, for up to `MAX_CONNECTIONS` clients that read the answers."""

    def __init__(
        self, line: PlcLine, listener: socket.socket, plc_addresses: Collection[str]
    ) -> None:
        self._line, self._plc_addresses = line, plc_addresses
        page = [
            SimData(0, count=STATION_WORDS, datatype=DataType.REGISTERS, readonly=True),
            SimData(PLC_ADDRESS, count=PLC_WORDS, datatype=DataType.REGISTERS),
        ]
        super().__init__(
            SimDevice(0, page, action=self._serve),
            address=listener.getsockname()[:2],
            custom_pdu=[_ReadHolding, _ReadInput, _ReadWrite],
        )
        # pymodbus would make a socket of its own.
        self.call_create = partial(
            self.loop.create_server, self.handle_new_connection, sock=listener
        )

    def callback_new_connection(self) -> _Connection:
        """Return the handler of a client."""
        return _Connection(self)

    def admits(self, new: _Connection) -> bool:
        """Whether a new client may stay; a silent client may be closed to make room."""
        if self._plc_addresses and _peer(new) not in self._plc_addresses:
            return False
        connections = cast(dict[str, _Connection], self.active_connections).values()
        others = [
            other
            for other in connections
            if other is not new and other.transport and not other.transport.is_closing()
        ]
        if len(others) < MAX_CONNECTIONS:
            return True
        quietest = min(others, key=lambda other: other.heard_s)
        if time.monotonic() - quietest.heard_s < IDLE_S:
            return False
        cast(asyncio.Transport, quietest.transport).abort()
        return True

    async def _serve(
        self,
        function: int,
        start: int,
        address: int,
        _count: int,
        registers: list[int],
        values: Any,
    ) -> ExcCodes | None:
        """Fill in the registers before they are read, and pass on what is written."""
        if function not in (*_READS, *_WRITES):
            return ExcCodes.ILLEGAL_FUNCTION
        if values is not None:
            try:
                self._line.write(address, values)
            except ValueError:
                return ExcCodes.ILLEGAL_VALUE
        registers[-start : STATION_WORDS - start] = self._line.station_words()
        first = PLC_ADDRESS - start
        registers[first : first + PLC_WORDS] = self._line.plc_words()
        return None

    async def maintain(self, where: str) -> None:
        """Increment the heartbeat, and close connections that do not read."""
        while True:
            transports = [connection.transport for connection in self.active_connections.values()]
            for transport in transports:
                if (
                    isinstance(transport, asyncio.WriteTransport)
                    and transport.get_write_buffer_size() > _MAX_UNREAD_BYTES
                ):
                    _reset(transport)
            self._line.tick(len(transports), where)
            await asyncio.sleep(TICK_S)


def _peer(connection: _Connection) -> str:
    peer = connection.transport.get_extra_info("peername") or ("",)
    return str(peer[0]).removeprefix("::ffff:")  # IPv4 at a socket of IPv6


def _reset(transport: asyncio.WriteTransport) -> None:
    """Close a connection at once; otherwise the system tries for minutes to deliver its answers."""
    connection = transport.get_extra_info("socket")
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    transport.abort()


@contextmanager
def serving_modbus(line: PlcLine, settings: ModbusConfig) -> Iterator[str]:
    """Serve the registers of a line while the block runs; yield ``HOST:PORT``."""
    listener = listening_socket(
        "modbus",
        settings.host,
        settings.port,
        advice="give another host or port in station.toml",
        max_unacknowledged_ms=_MAX_UNACKNOWLEDGED_MS,
        send_buffer_bytes=_MAX_UNREAD_BYTES,
    )
    where = f"{settings.host}:{listener.getsockname()[1]}"
    loop = asyncio.new_event_loop()
    started: threading.Event = threading.Event()
    stopping = asyncio.Event()
    failures: list[BaseException] = []

    async def serve() -> None:
        server = _Server(line, listener, {str(address) for address in settings.plc_addresses})
        await server.serve_forever(background=True)
        started.set()
        maintenance = asyncio.create_task(server.maintain(where))
        maintenance.add_done_callback(_log_failure)
        await stopping.wait()
        maintenance.cancel()
        await server.shutdown()

    def run() -> None:
        try:
            loop.run_until_complete(serve())
        except BaseException as error:
            failures.append(error)
        finally:
            started.set()
            loop.close()
            listener.close()  # also if the server did not start

    thread = threading.Thread(target=run, name="modbus", daemon=True)
    thread.start()
    if not started.wait(_START_S) or failures:
        reason = error_text(failures[0]) if failures else f"no answer within {_START_S:g} s"
        raise InputError(f"[modbus] {where}: the server did not start: {reason}")
    try:
        with line:
            yield where
    finally:
        loop.call_soon_threadsafe(stopping.set)
        thread.join()


def _log_failure(maintenance: asyncio.Task[None]) -> None:
    """Log the error that stopped the heartbeat."""
    if not maintenance.cancelled() and (error := maintenance.exception()) is not None:
        _log.error("the heartbeat to the PLC stopped", exc_info=error)


class PlcConnection:
    """Connection of a program that acts as the PLC, and reads and writes whole pages.

    Without an answer it raises `ConnectionError`.
    """

    def __init__(self, host: str, port: int, timeout_s: float = 3.0) -> None:
        self._where = f"{host}:{port}"
        self._client = ModbusTcpClient(host, port=port, timeout=timeout_s, retries=0)

    def __enter__(self) -> Self:
        if not self._client.connect():
            raise ConnectionError(f"{self._where}: cannot be reached")
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def read(self) -> dict[str, Any]:
        """Return the registers of the station by name, all of one moment."""
        answer = self._answer_to(self._client.read_input_registers, 0, count=STATION_WORDS)
        return decoded(STATION, answer.registers)

    def write(self, values: dict[str, Any]) -> None:
        """Write all that a PLC writes."""
        self._answer_to(self._client.write_registers, PLC_ADDRESS, encoded(PLC, values))

    def _answer_to(self, call: Any, *args: Any, **options: Any) -> Any:
        try:
            answer = call(*args, **options)
        except ModbusException as error:
            raise ConnectionError(f"{self._where}: {error}") from error
        if answer.isError():
            raise ConnectionError(f"{self._where}: {answer}")
        return answer
