"""Results for a real broker: retained, in order, without delaying the station."""

import json
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from capture.station.domain.interface_config import MqttConfig
from capture.station.line.mqtt import MAX_WAITING, MqttPublisher
from capture.station.run.events import Change, PartAnnounced, RecipeLoaded, State, StateChanged
from tests.capture.station.line.broker import Broker, mqtt_broker
from tests.capture.station.line.test_handshake import FAILED, result
from tests.capture.station.stations import published
from tests.waiting import until_so

# For a client that connects again after a second, on a loaded machine.
_TIMEOUT_S = 60.0
# After which a client has sent what it has.
_SILENCE_S = 0.3
TOPIC = "plant/line-1"
RESULT, STATE, ONLINE = (f"{TOPIC}/{name}" for name in ("result", "state", "online"))


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    with mqtt_broker(tmp_path) as made:
        yield made


def publisher(broker: Broker, said: list[str]) -> MqttPublisher:
    return MqttPublisher(MqttConfig(url=broker.url, topic=TOPIC), said.append)


def announced(*numbers: int) -> list[PartAnnounced]:
    return [PartAnnounced(result(number, FAILED), 1.0) for number in numbers]


def numbers(messages: dict[str, list[str]]) -> list[int]:
    return [json.loads(each)["number"] for each in messages.get(RESULT, [])]


@pytest.mark.mqtt
def test_the_last_result_is_retained_and_the_end_of_a_run_is_told(broker: Broker) -> None:
    broker.start()
    said: list[str] = []
    with publisher(broker, said) as mqtt, broker.subscribed(f"{TOPIC}/#") as live:
        mqtt.tell(*published(StateChanged(State.READY, Change.TESTED, why="tested")))
        for event in announced(1, 2, 3):
            mqtt.tell(*published(event))
        until_so(lambda: numbers(live) == [1, 2, 3])
        with broker.subscribed(f"{TOPIC}/#") as later:
            until_so(lambda: len(later) == 3)
            assert later[ONLINE] == ["true"]
            assert json.loads(later[STATE][0]) == {"state": "ready", "reason": "tested"}
            row: dict[str, Any] = json.loads(later[RESULT][0])
            assert (row["part_id"], row["decision"]) == ("part-000003", "FAIL")
            assert row["causes"] == ["defect", "shadow"]
    assert said == ["mqtt 127.0.0.1: connected"]
    with broker.subscribed(ONLINE) as later:
        until_so(lambda: later == {ONLINE: ["false"]})


@pytest.mark.mqtt
def test_a_new_connection_ends_the_one_before_it_with_its_last_will(broker: Broker) -> None:
    """A broker that was not told of a lost connection would publish its last will much later."""
    broker.start()
    lost: list[str] = []
    with publisher(broker, lost), broker.subscribed(ONLINE) as live:
        until_so(lambda: live == {ONLINE: ["true"]})
        with publisher(broker, []):
            until_so(lambda: live[ONLINE][:3] == ["true", "false", "true"])
            until_so(lambda: any("not connected" in text for text in lost))


@pytest.mark.mqtt
def test_the_end_of_a_run_is_told_to_a_broker_that_hangs(broker: Broker) -> None:
    broker.start()
    said: list[str] = []
    with publisher(broker, said) as mqtt, broker.subscribed(ONLINE) as live:
        until_so(lambda: live == {ONLINE: ["true"]})
        broker.process.send_signal(signal.SIGSTOP)
        for event in announced(1, 2):
            mqtt.tell(*published(event))
    broker.process.send_signal(signal.SIGCONT)
    with broker.subscribed(ONLINE) as later:
        until_so(lambda: later.get(ONLINE, [])[-1:] == ["false"])


@pytest.mark.mqtt
def test_results_wait_for_a_broker_that_is_started_late_and_killed(broker: Broker) -> None:
    said: list[str] = []
    with publisher(broker, said) as mqtt:
        for event in announced(1, 2):
            mqtt.tell(*published(event))
        broker.start()
        with broker.subscribed(RESULT) as messages:
            until_so(lambda: numbers(messages) in ([1, 2], [2]))  # retained when it subscribed
        broker.kill()
        until_so(lambda: len(said) > 1)
        for event in announced(3, 4):
            mqtt.tell(*published(event))
        broker.start()
        with broker.subscribed(RESULT) as messages:
            until_so(lambda: numbers(messages)[-1:] == [4])
    assert said[0].startswith("mqtt 127.0.0.1: ")
    assert said[-1] == "mqtt 127.0.0.1: connected"


@pytest.mark.mqtt
def test_a_broker_that_has_forgotten_everything_is_told_again(broker: Broker) -> None:
    """A broker without persistence that was restarted, while the station is idle."""
    broker.start()
    with publisher(broker, []) as mqtt:
        mqtt.tell(*published(RecipeLoaded("example", 2, "0" * 64)))
        mqtt.tell(*published(StateChanged(State.READY, Change.TESTED, why="tested")))
        for event in announced(1, 2):
            mqtt.tell(*published(event))
        with broker.subscribed(RESULT) as before:
            until_so(lambda: numbers(before)[-1:] == [2])
        broker.kill()
        broker.start()
        with broker.subscribed(f"{TOPIC}/#") as live:
            until_so(lambda: {*live} == {RESULT, STATE, ONLINE, f"{TOPIC}/recipe"})
            assert numbers(live) == [2]


KILLED = """
import sys, threading
from capture.station.domain.interface_config import MqttConfig
from capture.station.line.mqtt import MqttPublisher
with MqttPublisher(MqttConfig(url=sys.argv[1], topic=sys.argv[2]), print):
    threading.Event().wait()
"""


@pytest.mark.mqtt
def test_the_broker_tells_that_a_killed_station_is_offline(broker: Broker) -> None:
    broker.start()
    with broker.subscribed(ONLINE) as messages:
        with subprocess.Popen((sys.executable, "-c", KILLED, broker.url, TOPIC)) as station:
            until_so(lambda: messages.get(ONLINE) == ["true"])
            station.kill()
        until_so(lambda: messages[ONLINE] == ["true", "false"])


@pytest.mark.mqtt
def test_a_wrong_password_is_logged_once(broker: Broker) -> None:
    broker.start()
    said: list[str] = []
    wrong = broker.url.replace("p%40ss", "guess")
    with MqttPublisher(MqttConfig(url=wrong, topic=TOPIC), said.append):
        until_so(lambda: bool(said))
    assert said[0] == "mqtt 127.0.0.1: not connected: Not authorized"


@pytest.mark.mqtt
def test_the_oldest_results_are_dropped_while_the_broker_is_away(broker: Broker) -> None:
    said: list[str] = []
    last = MAX_WAITING + 50
    with publisher(broker, said) as mqtt:
        for event in announced(*range(1, last + 1)):
            mqtt.tell(*published(event))
        broker.start()
        with broker.subscribed(RESULT) as messages:
            until_so(lambda: numbers(messages)[-1:] == [last])
    assert "mqtt 127.0.0.1: 50 messages were dropped, the oldest ones" in said


@pytest.mark.parametrize(
    ("url", "topic"),
    [
        ("http://broker", "a"),
        ("mqtt://broker:99999", "a"),
        ("mqtt://broker/path", "a"),
        ("mqtt://broker", "a/+/b"),
    ],
)
def test_a_section_that_cannot_work_is_refused(url: str, topic: str) -> None:
    with pytest.raises(ValidationError):
        MqttConfig(url=url, topic=topic)


@pytest.mark.slow
def test_a_broker_that_drops_every_connection_collects_no_messages() -> None:
    sent: list[bytes] = []  # by the client in each connection, once it is accepted

    def serve(listener: socket.socket) -> None:
        while len(sent) < 2:
            with listener.accept()[0] as connection:
                connection.settimeout(_TIMEOUT_S)
                connection.recv(1000)
                connection.sendall(b"\x20\x02\x00\x00")
                received = connection.recv(1000)
                connection.settimeout(_SILENCE_S)
                with suppress(TimeoutError):
                    while more := connection.recv(1000):
                        received += more
                sent.append(received)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(_TIMEOUT_S)
        thread = threading.Thread(target=serve, args=(listener,))
        thread.start()
        url = f"mqtt://127.0.0.1:{listener.getsockname()[1]}"
        with MqttPublisher(MqttConfig(url=url, topic=TOPIC), lambda _: None):
            thread.join()
    assert [each.count(ONLINE.encode()) for each in sent] == [1, 1]
