"""Production: a taught station, runs of it, and what must agree."""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from capture.base.names import SET_SUFFIX
from capture.session.verification import verify_file
from capture.station.domain.config import CONFIG
from capture.station.domain.folder import StationFolder, make_station, station_folder
from capture.station.judge.approval import approve
from capture.station.judge.challenge_set import add_to_challenge
from capture.station.judge.inspector import Inspector
from capture.station.judge.teaching.teaching import teach
from capture.station.results.store import open_store
from capture.station.results.verification import verify_station
from capture.station.run.events import Event
from capture.station.run.live_station import LiveStation
from capture.station.run.live_view import LiveEvent
from capture.station.run.run import run_station
from capture.station.run.triggers import TimerTrigger
from rig import RigConfig
from tests.capture.station.teaching_sets import SIDE_PX, acknowledge_faults, few_places, saved

SMALL_RIG = RigConfig().with_changes(camera={"width_px": SIDE_PX, "height_px": SIDE_PX})
VIRTUAL = SMALL_RIG.with_changes(simulation={"clock": "virtual"})


def taught_station(folder: Path, side_px: int = SIDE_PX, **config: object) -> Path:
    """Make a station that knows rock as good and sand as bad; `config` replaces its keys."""
    make_station(folder)
    configure(folder, **config)
    files = StationFolder(folder).recipe_files()
    rock = saved(folder / "shown", "rock", range(7), side_px)
    sand = saved(folder / "shown", "sand", range(3), side_px)
    with few_places():
        teach(files, rock[:6])
        teach(files, sand[:2], "loose sand")
    acknowledge_faults(files)
    add_to_challenge(files.challenge, rock[6:], "PASS")
    add_to_challenge(files.challenge, sand[2:], "FAIL")
    approve(files, "Ada")
    Inspector.load(files)
    return folder


def configure(folder: Path, **config: object) -> None:
    """Let a station run as fast as a busy machine can; `config` replaces its keys."""
    keys = {"timer_s": 0.0, "max_trigger_age_s": 60.0, "disk_floor_mb": 50, "reconnect_s": 0.05}
    keys |= config
    text = (folder / CONFIG).read_text(encoding="utf-8")
    kept = [line for line in text.splitlines() if line.split(" ")[0] not in keys]
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    (folder / CONFIG).write_text("\n".join([*lines, *kept, ""]), encoding="utf-8")


def run_parts(
    folder: Path,
    parts: int | None,
    listen: Callable[[LiveEvent], None],
    rig: RigConfig = SMALL_RIG,
    live: LiveStation | None = None,
) -> None:
    """Run a station as ``ps4rig station run`` does, with a timer."""
    live = live or LiveStation(folder.name, simulated=True)
    with station_folder(folder) as opened, live.telling(listen):
        source = TimerTrigger(opened.config.timer_s)
        run_station(opened, rig, source, live, parts=parts)


def collected(folder: Path, parts: int) -> list[Event]:
    """Let a station without a recipe collect parts, and return what it told."""
    events: list[Event] = []
    live = LiveStation("line", simulated=True)
    with station_folder(folder) as opened, live.telling(lambda each: events.append(each.event)):
        source = TimerTrigger(0.0)
        run_station(opened, VIRTUAL, source, live, parts=parts, is_collecting=True)
    return events


def contradictions(
    folder: Path, events: list[dict[str, Any]], read_every: int = 1
) -> Iterator[str]:
    """Say where announcements, rows and files of a station contradict each other.

    One in `read_every` set files is read whole.
    """
    begun = [event["part_id"] for event in events if event["event"] == "begun"]
    told = [event for event in events if event["event"] in ("part", "recovered")]
    station = StationFolder(folder)
    with open_store(station.results, station.config.name, exclusive=False) as store:
        rows = {entry.result.part_id: entry.result for entry in store.parts()}
    yield from (f"{part_id} was begun and has no row" for part_id in begun if part_id not in rows)
    for part_id, count in Counter(event["part_id"] for event in told).items():
        if count > 1:
            yield f"{part_id} was announced {count} times"
    for event in told:
        row = rows.get(event["part_id"])
        said = event["decision"], event["number"], event["set_file"]
        if row is None:
            yield f"{event['part_id']} was announced and has no row"
        elif said != (row.verdict.decision, row.number, row.set_file):
            yield f"{event['part_id']} was announced as {said}, its row is {row}"
    for row in rows.values():
        if row.verdict.decision == "PASS" and row.set_file is None:
            yield f"{row.part_id} passed without a set file"
    for finding in verify_station(folder):
        if finding.state != "good":
            yield str(finding)
    for path in islice((folder / "parts").glob(f"*/*{SET_SUFFIX}"), None, None, read_every):
        yield from (str(each) for each in verify_file(path) if each.state != "good")
