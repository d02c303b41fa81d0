"""Events reach their subscribers in order, also slow ones."""

import threading
from pathlib import Path

import pytest

from capture.station.domain.folder import LOG, StationFolder, make_station
from capture.station.run import live_station
from capture.station.run.events import Event, TriggerRefused, Warned, text_lines
from capture.station.run.live_station import LiveStation
from capture.station.run.live_view import LiveEvent

WAIT_S = 60.0


def test_an_event_never_waits_for_its_subscriber(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_station, "MAX_EVENTS", 3)
    go_on, told = threading.Event(), list[Event]()
    live = LiveStation("line-1", simulated=True)

    def listen(published: LiveEvent) -> None:
        assert go_on.wait(WAIT_S)
        told.append(published.event)

    def publish() -> None:
        for number in range(10):
            live.publish(Warned(str(number)))

    with live.telling(listen):
        publishing = threading.Thread(target=publish)
        publishing.start()
        publishing.join(WAIT_S / 2)
        is_done = not publishing.is_alive()
        waiting = threading.Thread(target=live.wait_for_room, args=(lambda: False,))
        waiting.start()
        live.wait_for_room(lambda: True)
        assert waiting.is_alive()
        go_on.set()
        waiting.join(WAIT_S)
        assert not waiting.is_alive()
    assert is_done
    assert told == [Warned(str(number)) for number in range(10)]


def test_a_subscriber_does_not_wait_for_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_station, "MAX_EVENTS", 0)
    told = threading.Event()
    live = LiveStation("line-1", simulated=True)

    def listen(_: LiveEvent) -> None:
        live.wait_for_room(told.is_set)
        told.set()

    with live.telling(listen):
        live.publish(Warned(""))
        is_told = told.wait(WAIT_S)
        told.set()
    assert is_told


@pytest.mark.parametrize(
    "event",
    [
        TriggerRefused("http", "A-1\n2026-01-01 ready\x1b[2J\ud800", "busy", recorded=True),
        TriggerRefused("http", None, "busy\r\nready: self-test passed\x85", recorded=True),
        Warned("the camera said: a\nb\x00"),
    ],
)
def test_no_text_from_outside_makes_a_line_or_a_command_of_the_terminal(
    event: TriggerRefused | Warned, tmp_path: Path
) -> None:
    [line] = text_lines(event)
    assert line.isprintable()
    make_station(tmp_path / "line-1")
    folder = StationFolder(tmp_path / "line-1")
    folder.log(line)
    [logged] = (folder.path / LOG).read_text(encoding="utf-8").split("\n")[:-1]
    assert logged.endswith(line)
