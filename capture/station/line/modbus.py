"""Modbus TCP by pymodbus: the station as a server, and a client as the PLC."""

import asyncio
import logging
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Self

from pymodbus.client import ModbusTcpClient
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusException
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from capture.station.domain.errors import error_text
from capture.station.domain.interface_config import ModbusConfig, listening_socket
from classify.base.errors import InputError

from .line import TICK_S, PlcLine
from .registers import PLC, PLC_ADDRESS, PLC_WORDS, STATION, STATION_WORDS, decoded, encoded

_log = logging.getLogger(__name__)
_READS, _WRITES = (3, 4, 23), (6, 16, 22, 23)
# A PLC, its spare, a panel of the line and a few programs of engineers.
MAX_CONNECTIONS = 16
# A hundred answers: a client with more unread answers does not read.
_MOST_UNREAD_BYTES = 16 * 1024
# A client that acknowledges nothing for this long does not read, or is gone. The bound above does
# not detect this: Linux can drop what arrives at a full client, with the acknowledgements of the
# client's own requests, so that neither side sends anything more.
_MOST_UNACKNOWLEDGED_MS = 10_000
_START_S = 60.0
# Not logged: errors in the requests of a client would fill the terminal.
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


class _Server(ModbusTcpServer):
    """The registers of a line, for up to `MAX_CONNECTIONS` clients that read the answers."""

    def __init__(self, line: PlcLine, listener: socket.socket) -> None:
        self._line = line
        page = [
            SimData(0, count=STATION_WORDS, datatype=DataType.REGISTERS, readonly=True),
            SimData(PLC_ADDRESS, count=PLC_WORDS, datatype=DataType.REGISTERS),
        ]
        super().__init__(SimDevice(0, page, action=self._serve), address=listener.getsockname()[:2])
        # pymodbus would make a socket of its own.
        self.call_create = partial(
            self.loop.create_server, self.handle_new_connection, sock=listener
        )

    async def _serve(
        self,
        function: int,
        start: int,
        address: int,
        _count: int,
        registers: list[int],
        values: Any,
    ) -> ExcCodes | None:
        """Fill in the registers before they are read; take what is written."""
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

    async def keep(self, where: str) -> None:
        """Count heartbeats, and close connections that are too many or do not read."""
        while True:
            transports = [connection.transport for connection in self.active_connections.values()]
            for number, transport in enumerate(transports):
                if not isinstance(transport, asyncio.WriteTransport):
                    continue
                if transport.get_write_buffer_size() > _MOST_UNREAD_BYTES:
                    _reset(transport)
                elif number >= MAX_CONNECTIONS:
                    transport.abort()
            self._line.tick(len(transports), where)
            await asyncio.sleep(TICK_S)


def _reset(transport: asyncio.WriteTransport) -> None:
    """Close a connection at once: the system would try for minutes to deliver what is unread."""
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
        most_unacknowledged_ms=_MOST_UNACKNOWLEDGED_MS,
        send_buffer_bytes=_MOST_UNREAD_BYTES,
    )
    where = f"{settings.host}:{listener.getsockname()[1]}"
    loop = asyncio.new_event_loop()
    started: threading.Event = threading.Event()
    stopping = asyncio.Event()
    failures: list[BaseException] = []

    async def serve() -> None:
        server = _Server(line, listener)
        await server.serve_forever(background=True)
        started.set()
        keeper = asyncio.create_task(server.keep(where))
        keeper.add_done_callback(_log_failure)
        await stopping.wait()
        keeper.cancel()
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


def _log_failure(keeper: asyncio.Task[None]) -> None:
    """Log why the heartbeat stopped, by which the PLC sees it."""
    if not keeper.cancelled() and (error := keeper.exception()) is not None:
        _log.error("the heartbeat to the PLC stopped", exc_info=error)


class PlcConnection:
    """The connection of a program that plays the PLC; it reads and writes whole pages.

    Raises `ConnectionError` if the station cannot be reached or does not answer.
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
        """Return what the station shows, by name, of one moment."""
        answer = self._asked(self._client.read_input_registers, 0, count=STATION_WORDS)
        return decoded(STATION, answer.registers)

    def write(self, values: dict[str, Any]) -> None:
        """Write all that a PLC writes."""
        self._asked(self._client.write_registers, PLC_ADDRESS, encoded(PLC, values))

    def _asked(self, call: Any, *args: Any, **options: Any) -> Any:
        try:
            answer = call(*args, **options)
        except ModbusException as error:
            raise ConnectionError(f"{self._where}: {error}") from error
        if answer.isError():
            raise ConnectionError(f"{self._where}: {answer}")
        return answer
