"""A mosquitto broker in a folder of a test, on a free port."""

import socket
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from tests.free_port import free_port
from tests.suites import MOSQUITTO
from tests.waiting import until_so


@dataclass
class Broker:
    """A broker; `start` and `kill` it."""

    folder: Path
    port: int
    process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"mqtt://ps4rig:p%40ss@127.0.0.1:{self.port}"

    def start(self) -> None:
        self.process = subprocess.Popen(
            (MOSQUITTO, "-c", self.folder / "mosquitto.conf"), stderr=subprocess.DEVNULL
        )
        until_so(self._listens)

    def _listens(self) -> bool:
        with socket.socket() as client:
            return client.connect_ex(("127.0.0.1", self.port)) == 0

    def kill(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    @contextmanager
    def subscribed(self, topic: str) -> Iterator[dict[str, list[str]]]:
        """Yield what comes on topics, retained messages first."""
        messages: dict[str, list[str]] = {}
        client = Client(CallbackAPIVersion.VERSION2)
        client.username_pw_set("ps4rig", "p@ss")
        subscribed = threading.Event()

        def keep(_client: Client, _data: Any, message: Any) -> None:
            messages.setdefault(message.topic, []).append(message.payload.decode())

        client.on_message = keep
        client.on_subscribe = lambda *_: subscribed.set()
        client.on_connect = lambda *_: client.subscribe(topic, qos=1)
        client.connect("127.0.0.1", self.port)
        client.loop_start()
        try:
            assert subscribed.wait(60)
            yield messages
        finally:
            client.disconnect()
            client.loop_stop()


@contextmanager
def mqtt_broker(folder: Path) -> Iterator[Broker]:
    """Make a broker that wants a password; it is not started."""
    port, passwords = free_port(), folder / "passwords"
    program = MOSQUITTO.parents[1] / "bin" / "mosquitto_passwd"
    subprocess.run((program, "-b", "-c", passwords, "ps4rig", "p@ss"), check=True)
    passwords.chmod(0o644)
    (folder / "mosquitto.conf").write_text(
        f"listener {port} 127.0.0.1\npassword_file {passwords}\nuser root\n", encoding="utf-8"
    )
    broker = Broker(folder, port)
    try:
        yield broker
    finally:
        broker.kill()
