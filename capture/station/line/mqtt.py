"""Publish the results of a station to an MQTT broker, as retained JSON."""

import hashlib
import json
import ssl
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Self
from urllib.parse import unquote, urlsplit

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from capture.station.domain.interface_config import MqttConfig
from capture.station.run.events import PartAnnounced, PartRecovered, RecipeLoaded, StateChanged
from capture.station.run.live_view import LiveEvent

# Largest number of waiting messages, of 2 kB each. With a result and two states for each part it
# covers five minutes of a line with a part a second.
MAX_WAITING = 1000
_PORTS = {"mqtt": 1883, "mqtts": 8883}
# Time for which the last results wait for the broker at the end of a run.
_LAST_S = 2.0
_KEEP_ALIVE_S = 30
_RECONNECT_S = 1, 30


class MqttPublisher:
    """Publishes announcements in their order, from its own thread.

    Each one is repeated until the broker confirms it. Beyond `MAX_WAITING` the oldest are dropped.
    """

    def __init__(self, settings: MqttConfig, log: Callable[[str], None]) -> None:
        url = urlsplit(settings.url)
        self._topic, self._log = settings.topic, log
        self._label = f"mqtt {url.hostname}"
        self._address = url.hostname or "", url.port or _PORTS[url.scheme]
        self._changed = threading.Condition()
        self._waiting: deque[tuple[str, str]] = deque()
        self._last: dict[str, str] = {}  # the last message of each topic
        self._dropped = 0
        self._is_sending = False
        self._confirmed_ids: set[int] = set()
        self._is_connected = self._is_closed = False
        self._last_logged = ""
        self._thread = threading.Thread(target=self._run, name="mqtt", daemon=True)
        # All connections of a station use the same client id: a broker that has not noticed the
        # loss of the earlier connection ends it, and publishes its last will, before it accepts
        # the new one and its "true".
        client_id = f"ps4rig-{hashlib.sha256(settings.topic.encode()).hexdigest()[:16]}"
        self._client = Client(CallbackAPIVersion.VERSION2, client_id=client_id)
        self._client.on_connect = self._connected
        self._client.on_connect_fail = lambda *_: self._log_change("cannot be reached")
        self._client.on_disconnect = self._disconnected
        self._client.on_publish = self._confirmed
        self._client.reconnect_delay_set(*_RECONNECT_S)
        self._client.will_set(f"{self._topic}/online", "false", qos=1, retain=True)
        if url.username is not None:
            password = None if url.password is None else unquote(url.password)
            self._client.username_pw_set(unquote(url.username), password)
        if url.scheme == "mqtts":
            self._client.tls_set_context(ssl.create_default_context())

    def __enter__(self) -> Self:
        self._client.connect_async(*self._address, keepalive=_KEEP_ALIVE_S)
        self._client.loop_start()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._changed.wait_for(lambda: not self._waiting and not self._is_sending, _LAST_S)
            self._is_closed = True
            self._changed.notify_all()
        self._thread.join()
        # Even if messages still wait: after a disconnect the broker publishes no last will.
        self._client.publish(f"{self._topic}/online", "false", qos=1, retain=True)
        self._client.disconnect()
        self._client.loop_stop()

    def tell(self, live: LiveEvent) -> None:
        """Handle an event of the station."""
        match live.event:
            case PartAnnounced(result) | PartRecovered(result):
                name, text = "result", json.dumps(result.row)
            case RecipeLoaded() as recipe:
                name, text = "recipe", json.dumps(vars(recipe))
            case StateChanged(state) as changed:
                name, text = "state", json.dumps({"state": state, "reason": changed.reason})
            case _:
                return
        with self._changed:
            self._put(name, text)

    def _put(self, name: str, text: str) -> None:
        topic = f"{self._topic}/{name}"
        self._last[topic] = text
        self._waiting.append((topic, text))
        if len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self._dropped += 1
        self._changed.notify_all()

    # Called in the sending thread.

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(
                    lambda: self._is_closed or (self._is_connected and bool(self._waiting))
                )
                if self._is_closed:
                    return
                (topic, text), dropped = self._waiting.popleft(), self._dropped
                self._is_sending, self._dropped = True, 0
                self._confirmed_ids.clear()
            if dropped:
                self._log(f"{self._label}: {dropped} messages were dropped, the oldest ones")
            self._send(topic, text)

    def _send(self, topic: str, text: str) -> None:
        """Send a message, and wait until the broker has confirmed it.

        After a lost connection, paho sends it again.
        """
        # Not under our lock: paho calls `_confirmed`, which takes it, under its own lock.
        message_id = self._client.publish(topic, text, qos=1, retain=True).mid
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or message_id in self._confirmed_ids)
            self._is_sending = False
            self._changed.notify_all()

    # Called by paho, in its own thread.

    def _confirmed(self, _client: Client, _data: Any, message_id: int, *_: Any) -> None:
        with self._changed:
            self._confirmed_ids.add(message_id)
            self._changed.notify_all()

    def _connected(self, client: Client, _data: Any, _flags: Any, reason: Any, *_: Any) -> None:
        if reason.is_failure:
            self._log_change(f"not connected: {reason}")
            return
        # Without confirmation: else paho would keep one message for each connection that a broker
        # closes before it confirms, and send them all before any result.
        client.publish(f"{self._topic}/online", "true", qos=0, retain=True)
        with self._changed:
            self._is_connected = True
            # The broker may have lost what it retained.
            waiting_topics = {topic for topic, _ in self._waiting}
            self._waiting += [
                (topic, text) for topic, text in self._last.items() if topic not in waiting_topics
            ]
            self._changed.notify_all()
        self._log_change("connected")

    def _disconnected(self, _client: Client, _data: Any, _flags: Any, reason: Any, *_: Any) -> None:
        with self._changed:
            self._is_connected = False
        self._log_change(f"not connected: {reason}")

    def _log_change(self, text: str) -> None:
        if text != self._last_logged and not self._is_closed:
            self._last_logged = text
            self._log(f"{self._label}: {text}")
