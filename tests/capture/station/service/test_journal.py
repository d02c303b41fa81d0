"""Entries of the journal, as a socket of its protocol receives them."""

import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from capture.base.outputs import escaped
from capture.station.domain.verdict import Decision
from capture.station.results.part_result import PartResult
from capture.station.results.store import BegunPart
from capture.station.run.events import (
    Change,
    ExposureComplete,
    PartAnnounced,
    SelfTestFinished,
    State,
    StateChanged,
    TriggerRefused,
    Warned,
)
from capture.station.service.systemd import Journal, is_connected_to_journal
from rig.doctor.check import Check
from tests.capture.station.results.parts import UTC, result_of
from tests.capture.station.stations import published


def part(decision: Decision) -> PartResult:
    return result_of(BegunPart("part-000017", 17, "timer", UTC, simulated=True), decision)


def decoded(entry: bytes) -> list[tuple[str, str]]:
    """Fields of an entry, read as journald reads them."""
    fields = []
    while entry:
        line, _, rest = entry.partition(b"\n")
        name, is_text, value = line.partition(b"=")
        if not is_text:
            [size] = struct.unpack("<Q", rest[:8])
            value, entry = rest[8 : 8 + size], rest[9 + size :]
        else:
            entry = rest
        fields.append((name.decode(), value.decode()))
    return fields


@pytest.fixture
def journald(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "journal"))
        listening.settimeout(10.0)
        yield listening


@pytest.fixture
def journal(journald: socket.socket) -> Journal:
    return Journal("line-3", Path(journald.getsockname()))


def test_a_part_is_found_by_its_id_verdict_and_causes(
    journal: Journal, journald: socket.socket
) -> None:
    journal.tell(*published(PartAnnounced(part(Decision.FAIL), 42.0)))
    fields = decoded(journald.recv(1 << 16))
    assert fields[0] == (
        "MESSAGE", "part-000017 FAIL, simulated: it is a FAIL (42 ms)"
    )  # fmt: skip
    for expected in (
        ("PRIORITY", "5"),
        ("SYSLOG_IDENTIFIER", "ps4rig"),
        ("PS4RIG_STATION", "line-3"),
        ("PS4RIG_EVENT", "part"),
        ("PS4RIG_PART_ID", "part-000017"),
        ("PS4RIG_NUMBER", "17"),
        ("PS4RIG_DECISION", "FAIL"),
        ("PS4RIG_CAUSES", "defect"),
        ("PS4RIG_SIMULATED", "True"),
    ):
        assert expected in fields


@pytest.mark.parametrize(
    ("event", "priority"),
    [
        (StateChanged(State.READY, Change.TESTED, why="tested"), "6"),
        (StateChanged(State.ERROR, Change.FAILED, why="no camera"), "3"),
        (PartAnnounced(part(Decision.PASS), 1.0), "6"),
        (PartAnnounced(part(Decision.UNKNOWN), 1.0), "5"),
        (PartAnnounced(part(Decision.ERROR), 1.0), "4"),
        (TriggerRefused("timer", None, "busy", True), "4"),
        (Warned("drift"), "4"),
        (SelfTestFinished((Check("disk", "ok", "fine"),)), "6"),
        (SelfTestFinished((Check("LED 90", "fault", "dead"),)), "3"),
    ],
)
def test_the_priority_says_how_bad_it_is(
    journal: Journal, journald: socket.socket, event: object, priority: str
) -> None:
    journal.tell(*published(event))
    assert ("PRIORITY", priority) in decoded(journald.recv(1 << 16))


def test_a_text_of_several_lines_cannot_forge_a_field(
    journal: Journal, journald: socket.socket
) -> None:
    text = "odd\nPRIORITY=0\nPS4RIG_PART_ID=part-000001\udc80"
    journal.tell(*published(Warned(text)))
    fields = decoded(journald.recv(1 << 16))
    assert fields[0] == ("MESSAGE", f"warning: {escaped(text)}")
    assert ("PRIORITY", "0") not in fields


def test_what_nobody_is_told_makes_no_entry(journal: Journal, journald: socket.socket) -> None:
    journal.tell(*published(ExposureComplete("part-000017", 17)))
    journald.settimeout(0.05)
    with pytest.raises(TimeoutError):
        journald.recv(1 << 16)


def test_a_missing_journal_does_not_disturb_the_station(tmp_path: Path) -> None:
    Journal("line-3", tmp_path / "gone").tell(*published(Warned("drift")))


def test_only_the_stream_that_systemd_names_leads_to_the_journal(tmp_path: Path) -> None:
    with (tmp_path / "a").open("w") as stream, (tmp_path / "b").open("w") as other:
        about = os.fstat(stream.fileno())
        named = {"JOURNAL_STREAM": f"{about.st_dev}:{about.st_ino}"}
        assert is_connected_to_journal(named, stream.fileno())
        assert not is_connected_to_journal(named, other.fileno())
        assert not is_connected_to_journal({}, stream.fileno())
