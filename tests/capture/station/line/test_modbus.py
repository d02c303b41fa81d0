"""A real pymodbus client and a station with a fake rig: the documented end of each fault."""

import itertools
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from pymodbus.client import ModbusTcpClient
from pymodbus.constants import ExcCodes

from capture.sets.captured_set import CapturedSet
from capture.station.domain.interface_config import ModbusConfig
from capture.station.domain.verdict import Decision
from capture.station.line.handshake import Handshake
from capture.station.line.line import PlcLine
from capture.station.line.modbus import MAX_CONNECTIONS, serving_modbus
from capture.station.line.registers import (
    PAGE_VERSION,
    PLC_ADDRESS,
    PLC_WORDS,
    STATION_WORDS,
    VERDICTS,
    Status,
)
from capture.station.run.live_station import LiveStation
from classify.base.errors import InputError
from tests.capture.station.line.lines import (
    NOTHING,
    SESSION,
    WAIT_S,
    acknowledge,
    running_line,
    trigger,
    until,
)
from tests.waiting import until_so


def test_a_client_that_disconnects_in_mid_part_finds_its_result_later(
    tmp_path: Path, captured: CapturedSet
) -> None:
    exposing = threading.Event()
    with running_line(
        tmp_path / "line-1",
        captured,
        before=lambda bench: setattr(bench.camera, "on_capture", lambda _: exposing.wait(WAIT_S)),
    ) as line:
        with line.client() as plc:
            trigger(plc, 1)
            number = until(plc, Status.ACK)["number"]
        until_so(lambda: line.device()[0] == "warning")
        exposing.set()
        with line.client() as plc:
            read = until(plc, Status.RESULTS_VALID | Status.EXPOSURE_COMPLETE)
            assert (read["session"], read["result_number"]) == (SESSION, number)
            assert Status.ACK in Status(read["status"])  # the registers keep what was written
            acknowledge(plc, number)
            assert not Status(plc.read()["status"]) & (Status.ACK | Status.RESULTS_VALID)


def test_nonsense_gets_a_modbus_exception_and_changes_nothing(
    tmp_path: Path, captured: CapturedSet
) -> None:
    with (
        running_line(tmp_path / "line-1", captured) as line,
        line.client() as plc,
        ModbusTcpClient("127.0.0.1", port=line.port, timeout=WAIT_S) as client,
    ):
        before = until(plc, Status.READY)
        commands = PLC_ADDRESS + 1
        for answer, code in (
            (client.write_register(commands, 0x8000), ExcCodes.ILLEGAL_VALUE),
            (client.write_register(3, 1), ExcCodes.ILLEGAL_ADDRESS),
            (client.write_registers(STATION_WORDS - 1, [1, 1]), ExcCodes.ILLEGAL_ADDRESS),
            (client.read_input_registers(STATION_WORDS - 1, count=2), ExcCodes.ILLEGAL_ADDRESS),
            (client.write_coil(commands, True), ExcCodes.ILLEGAL_FUNCTION),
        ):
            assert answer.isError(), answer
            assert answer.exception_code == code
        for function in (3, 4):
            for count in (0, 126, 0xFFFF):
                assert raw_answer(line.port, function, count) == (function | 0x80, 3)
        after = plc.read()
        del before["heartbeat"], after["heartbeat"]
        assert after == before
        mirrored = client.read_holding_registers(0, count=STATION_WORDS).registers
        assert mirrored[:3] == [PAGE_VERSION, 0, SESSION]  # both functions read both pages
        written = client.read_input_registers(PLC_ADDRESS, count=PLC_WORDS).registers
        assert written == [0] * PLC_WORDS
    assert line.bench.announced() == []


def raw_answer(port: int, function: int, count: int) -> tuple[int, int]:
    """Function and exception code of the answer to a read that no client library would send."""
    with socket.create_connection(("127.0.0.1", port), timeout=WAIT_S) as client:
        client.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, function, 0, count))
        answer = client.recv(100)
    return answer[7], answer[8]


def is_closed(client: socket.socket) -> bool:
    """Whether the station closed a connection, with or without a reset."""
    try:
        return client.recv(1) == b""
    except ConnectionError:
        return True


def test_the_limit_of_connections_holds_at_once_and_silent_clients_leave_for_others(
    tmp_path: Path, captured: CapturedSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ExitStack() as stack:
        line = stack.enter_context(running_line(tmp_path / "line-1", captured))
        where = ("127.0.0.1", line.port)
        plc = stack.enter_context(line.client())
        silent = [
            stack.enter_context(socket.create_connection(where, timeout=WAIT_S))
            for _ in range(MAX_CONNECTIONS - 1)
        ]
        with socket.create_connection(where, timeout=WAIT_S) as further:
            assert is_closed(further)
        until(plc, Status.READY)
        monkeypatch.setattr("capture.station.line.modbus.IDLE_S", 0.0)
        until(plc, Status.READY)  # heard later than the silent ones
        with line.client() as other:
            until(other, Status.READY)
        assert is_closed(silent[0])
        until(plc, Status.READY)


def test_only_the_addresses_of_the_plc_may_connect(
    tmp_path: Path, captured: CapturedSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = ModbusConfig.model_validate({"port": 0, "plc_addresses": ["127.0.0.2"]})
    monkeypatch.setattr("tests.capture.station.line.lines.ANY_PORT", settings)
    with running_line(tmp_path / "line-1", captured) as line:
        with socket.create_connection(("127.0.0.1", line.port), timeout=WAIT_S) as other:
            assert is_closed(other)
        plc = socket.create_connection(
            ("127.0.0.1", line.port), timeout=WAIT_S, source_address=("127.0.0.2", 0)
        )
        with plc:
            plc.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 0, 1))
            assert plc.recv(100)[7] == 4


@pytest.mark.slow
@pytest.mark.parametrize("shrinks", [False, True], ids=["fills up", "drops answers"])
def test_a_client_that_reads_no_answers_and_connections_beyond_the_limit_are_closed(
    tmp_path: Path, captured: CapturedSet, shrinks: bool
) -> None:
    read = struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 0, STATION_WORDS)
    with running_line(tmp_path / "line-1", captured) as line, line.client() as plc:
        with socket.socket() as deaf:
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192 if shrinks else 4096)
            deaf.settimeout(WAIT_S)
            deaf.connect(("127.0.0.1", line.port))
            with suppress(ConnectionError):
                for number in itertools.count():
                    deaf.sendall(read)
                    plc.read()  # not faster than the station answers
                    if shrinks and number == 5:
                        # Linux drops answers that it had room for, and what they acknowledge.
                        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        others = [
            socket.create_connection(("127.0.0.1", line.port), timeout=WAIT_S)
            for _ in range(MAX_CONNECTIONS)
        ]
        assert is_closed(others[-1])
        for each in others:
            each.close()
        trigger(plc, 1)
        assert until(plc, Status.RESULTS_VALID)["result_number"] == 1


def test_a_client_that_polls_without_a_pause_sees_whole_pages_and_delays_no_part(
    tmp_path: Path, captured: CapturedSet
) -> None:
    over, reads = threading.Event(), []

    def until_polled(number: int) -> None:
        until_so(lambda: number in {read["result_number"] for read in reads[-100:]})

    with running_line(tmp_path / "line-1", captured) as line, line.client() as plc:

        def poll() -> None:
            with line.client() as other:
                while not over.is_set():
                    reads.append(other.read())

        poller = threading.Thread(target=poll)
        poller.start()
        try:
            until_polled(0)
            for number in range(1, 6):
                trigger(plc, number, f"A-{number}")
                until(plc, Status.RESULTS_VALID)
                until_polled(number)
                acknowledge(plc, number)
        finally:
            over.set()
            poller.join()
    for read in reads:
        is_valid = Status.RESULTS_VALID in Status(read["status"])
        number = read["result_number"]
        part_id, verdict = (f"A-{number}", VERDICTS[Decision.PASS]) if is_valid else ("", 0)
        assert is_valid is (number != 0)
        assert (read["result_part_id"], read["verdict"]) == (part_id, verdict)
    assert {read["result_number"] for read in reads} == set(range(6))
    print(f"{len(reads)} reads during 5 parts")


@pytest.mark.slow
def test_a_poll_costs_little(tmp_path: Path, captured: CapturedSet) -> None:
    polls = 2000
    with running_line(tmp_path / "line-1", captured) as line:
        with line.client() as plc:
            until(plc, Status.READY)
        client = (
            "import sys; from capture.station.line.modbus import PlcConnection\n"
            "with PlcConnection('127.0.0.1', int(sys.argv[1])) as plc:\n"
            f"    [plc.read() for _ in range({polls})]"
        )
        began_s = time.process_time()
        subprocess.run((sys.executable, "-c", client, str(line.port)), check=True, timeout=WAIT_S)
        poll_s = (time.process_time() - began_s) / polls
    print(f"a poll costs the station {1e6 * poll_s:.0f} us of processor time")
    assert poll_s < 1e-3


@pytest.mark.slow
def test_a_plc_whose_heartbeat_stops_is_shown_as_a_fault(
    tmp_path: Path, captured: CapturedSet
) -> None:
    now_s = [0.0]
    with running_line(tmp_path / "line-1", captured, now_s=lambda: now_s[0]) as line:
        until_so(lambda: line.device()[0] == "warning")
        with line.client() as plc:
            until_so(lambda: line.device() == ("ok", "connected, without a heartbeat"))
            plc.write(NOTHING | {"heartbeat": 3})
            until_so(lambda: line.device() == ("ok", "connected"))
            now_s[0] = 10.0
            until_so(lambda: line.device() == ("fault", "the heartbeat of the PLC stays at 3"))
            beats = plc.read()["heartbeat"]
            until_so(lambda: plc.read()["heartbeat"] != beats)


def test_a_taken_port_is_named() -> None:
    live = LiveStation("line-1", simulated=True)
    line = PlcLine(live, Handshake(SESSION, plc_triggers=True, station=live.state))
    with socket.create_server(("127.0.0.1", 0)) as other:
        settings = ModbusConfig(port=other.getsockname()[1])
        with (
            pytest.raises(InputError, match=rf"\[modbus\] 127.0.0.1:{settings.port}: Address"),
            serving_modbus(line, settings),
        ):
            pass
