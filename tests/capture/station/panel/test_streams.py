"""Memory and processor time that five open browsers cost a station.

pytest -s -m slow tests/capture/station/panel/test_streams.py prints the figures.
"""

import http.client
import threading
import time
from pathlib import Path

import pytest

from capture.station.domain.folder import StationFolder, make_station
from capture.station.domain.interface_config import PanelConfig
from capture.station.panel.panel import Panel
from capture.station.panel.server import serving_panel
from capture.station.run.events import (
    ExposureComplete,
    PartAnnounced,
    PartBegun,
    StateChanged,
)
from capture.station.run.live_station import LiveStation
from capture.station.run.states import Change, State
from tests.capture.station.panel.panels import Client
from tests.capture.station.panel.test_live import result
from tests.memory_growth import resident_mb

STREAMS, PARTS = 5, 2000
# Of the kernels' and the reader's own noise; a history of 2000 results would take 10 MB.
MOST_GROWTH_MB = 3.0
# A part of 1024 x 1024 px is judged in 120 ms, of which this is a tenth.
MOST_CPU_MS = 12.0
# A stream is never so late, however busy the machine.
LONGEST_S = 120.0


class Follower(threading.Thread):
    """Counts the parts of an event stream."""

    def __init__(self, host: str) -> None:
        super().__init__(daemon=True)
        self.parts = 0
        self._connection = http.client.HTTPConnection(host, timeout=60)
        self._connection.request("GET", "/api/v1/events")
        self._answer = self._connection.getresponse()
        # The stream subscribes between its headers and the state, which has the parts until then.
        next(line for line in self._answer if line == b"event: snapshot\n")

    def run(self) -> None:
        for line in self._answer:
            self.parts += line == b"event: part\n"


@pytest.mark.slow
def test_five_streams_see_every_part_and_memory_stays_flat(tmp_path: Path) -> None:
    make_station(tmp_path / "line-1")
    live = LiveStation("line-1", simulated=True)
    panel = Panel.of(StationFolder(tmp_path / "line-1"), live, PanelConfig(port=0))
    with serving_panel(panel) as url:
        followers = [Follower(Client(url).host) for _ in range(STREAMS)]
        for follower in followers:
            follower.start()
        slowest_s, early_mb, began_s = 0.0, 0.0, time.process_time()
        for number in range(1, PARTS + 1):
            announced = result(number)
            begun_s = time.perf_counter()
            for event in (
                StateChanged(State.EXECUTING, Change.TRIGGERED),
                PartBegun(announced.part_id, number),
                ExposureComplete(announced.part_id, number),
                StateChanged(State.READY, Change.FREE),
                PartAnnounced(announced, 80.0),
            ):
                live.publish(event)
            slowest_s = max(slowest_s, time.perf_counter() - begun_s)
            if number == PARTS // 10:
                early_mb = resident_mb()
            if number % 20 == 0:  # a station announces no twenty parts at once
                until_s = time.monotonic() + LONGEST_S
                while min(follower.parts for follower in followers) < number:
                    assert time.monotonic() < until_s, "a follower missed a part"
                    time.sleep(0.001)
        cpu_ms = 1e3 * (time.process_time() - began_s) / PARTS
        growth_mb = resident_mb() - early_mb
    print(f"{STREAMS} streams, {PARTS} parts: {cpu_ms:.2f} ms of CPU a part, with the readers;"
          f" the publisher waits {1e3 * slowest_s:.1f} ms at most; memory grows by"
          f" {growth_mb:.1f} MB after the first tenth")  # fmt: skip
    assert growth_mb < MOST_GROWTH_MB
    assert cpu_ms < MOST_CPU_MS
