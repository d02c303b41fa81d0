"""A panel that is killed again and again, and a browser that follows it."""

import http.client
import itertools
import json
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from capture.station.domain.folder import StationFolder
from capture.station.domain.interface_config import PanelConfig
from capture.station.panel.panel import Panel
from capture.station.panel.server import serving_panel
from capture.station.panel.station_link import StationLink
from capture.station.results.part_result import PartResult

_PAUSE_S = 0.05


def be_the_panel(folder: Path, listener: socket.socket) -> None:
    """Serve the panel of a station on a socket that outlives it."""
    station = StationFolder(folder)
    panel = Panel(station, StationLink(station), PanelConfig(port=0))
    with serving_panel(panel, listener):
        threading.Event().wait()


def be_the_browser(port: int, write: Callable[..., None]) -> None:
    """Follow the events of a panel as a browser does, and write down what it shows."""
    last = ""
    while True:
        with suppress(OSError, http.client.HTTPException):
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
            connection.request("GET", "/api/v1/events", headers={"Last-Event-ID": last})
            for line in connection.getresponse():
                name, _, value = line.decode().rstrip("\n").partition(": ")
                if name == "id":
                    last = value
                elif name == "data":
                    _write_down(last, json.loads(value), write)
        time.sleep(_PAUSE_S)


def _write_down(event_id: str, about: dict[str, Any], write: Callable[..., None]) -> None:
    run, _, number = event_id.partition(".")
    if about["event"] == "snapshot":
        write(run=run, snapshot=int(number), last=_shown(about["last"]))
    elif about["event"] == "part":
        write(run=run, event_id=int(number), shown=_shown(about))
    else:
        write(run=run, event_id=int(number))


def _shown(part: dict[str, Any] | None) -> dict[str, Any] | None:
    return (
        None if part is None else {name: part[name] for name in ("number", "part_id", "decision")}
    )


def contradictions(rows: dict[int, PartResult], journal: list[dict[str, Any]]) -> Iterator[str]:
    """Say where the browser was shown another verdict than the row, a part twice, or missed one.

    A snapshot stands for all events before it.
    """
    events = [each for each in journal if "event_id" in each or "snapshot" in each]
    for each in events:
        part = each.get("shown") or each.get("last")
        if part is None:
            continue
        row = rows.get(part["number"])
        if row is None or (row.part_id, row.verdict.decision) != (
            part["part_id"],
            part["decision"],
        ):
            yield f"{part} was shown, its row is {row}"
    counts = Counter(each["shown"]["part_id"] for each in events if "shown" in each)
    yield from (
        f"{part_id} was shown {count} times" for part_id, count in counts.items() if count > 1
    )
    for before, after in itertools.pairwise(events):
        known = before.get("event_id", before.get("snapshot"))
        if "event_id" in after and (after["run"], after["event_id"]) != (before["run"], known + 1):
            yield f"after {before} came {after}"
