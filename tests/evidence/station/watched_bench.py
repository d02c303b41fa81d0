"""The bench of a station with its panel, as `ps4rig station run` is.

    python -m tests.evidence.station.watched_bench FOLDER PARTS FRAME_PX CLASSES

Prints the address of the panel, and waits for a line. Then it judges the parts, prints what it
measured as one line of JSON, and serves the panel until its input ends.
"""

import json
import sys
import time
from dataclasses import asdict
from pathlib import Path

from capture.base.process_settings import configure_process


def main(folder: Path, parts: int, frame_px: int, classes: int) -> None:
    """Run the bench; see the module."""
    configure_process()  # before numpy is imported

    from capture.station.domain.config import CONFIG
    from capture.station.domain.folder import StationFolder, make_station
    from capture.station.panel.process import panel_process
    from capture.station.panel.server import panel_address, panel_listener
    from capture.station.run.bench import run_bench
    from capture.station.run.events import Event, PartAnnounced
    from capture.station.run.live_socket import serving_live
    from capture.station.run.live_station import LiveStation
    from tests.capture.station.panel.panels import ANY_PORT

    if not (folder / CONFIG).exists():
        make_station(folder)
    used_s: list[float] = []

    class MeasuredStation(LiveStation):
        def publish(self, event: Event) -> None:
            super().publish(event)
            if isinstance(event, PartAnnounced):
                used_s.append(time.process_time())

    live = MeasuredStation("bench", simulated=True)
    listener = panel_listener(folder, ANY_PORT)
    with (
        serving_live(StationFolder(folder), live),
        panel_process(folder, ANY_PORT, listener, print),
    ):
        print(panel_address(ANY_PORT, listener), flush=True)
        sys.stdin.readline()
        result = run_bench(folder, parts, frame_px, classes, live=live)
        last = live.snapshot().last
        used_ms = 1e3 * (used_s[-1] - used_s[0]) / (parts - 1)
        found = {"bench": asdict(result), "used_ms": used_ms, "last_part": last.part_id}
        print(json.dumps(found), flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
