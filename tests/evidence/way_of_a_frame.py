"""Functions and files of the program that one part of a simulated station enters.

    python -m tests.evidence.way_of_a_frame [--list]

A station on the simulated rig is taught and runs. The calls of all its threads are recorded from
the start of one part to its announcement; `--list` prints them in the order of the first call.
The command prints functions and files of each folder beside the limit of their sums.
"""

import argparse
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, FrameType

from capture.station.run.events import PartAnnounced, PartBegun
from capture.station.run.live_view import LiveEvent
from tests.capture.station.production import run_parts, taught_station

ROOT = Path(__file__).parents[2]
ROOMS = ("firmware_sim", "rig", "classify", "capture")
MOST_FUNCTIONS, MAX_FILES = 300, 60
# The parts before it fill caches and compile kernels.
_RECORDED_PART = 4


class CallRecorder:
    """Functions that all threads call while one part is in progress."""

    def __init__(self) -> None:
        self.functions: dict[CodeType, None] = {}
        self._is_recording = False

    def listen(self, live: LiveEvent) -> None:
        """Begin and end at the events of the recorded part."""
        event = live.event
        if isinstance(event, PartBegun) and event.number == _RECORDED_PART:
            self._is_recording = True
        if isinstance(event, PartAnnounced) and event.result.number == _RECORDED_PART:
            self._is_recording = False

    def record(self, frame: FrameType, kind: str, _: object) -> None:
        """Profile function of `threading.setprofile`."""
        if self._is_recording and kind == "call":
            self.functions[frame.f_code] = None

    def calls(self) -> list[tuple[str, str]]:
        """File and qualified name of each function, in the order of the first call."""
        rooms = tuple(f"{ROOT / room}/" for room in ROOMS)
        calls = [
            (str(Path(code.co_filename).relative_to(ROOT)), code.co_qualname)
            for code in self.functions
            if code.co_filename.startswith(rooms)
        ]
        # Comprehensions, generator expressions and lambdas belong to the function around them.
        return [call for call in calls if not call[1].endswith(">")]


def recorded_calls() -> list[tuple[str, str]]:
    """Run a station for some parts, and return the calls of the last but one."""
    recorder = CallRecorder()
    # Teaching starts worker threads that judge as well.
    threading.setprofile(recorder.record)
    try:
        with tempfile.TemporaryDirectory() as folder:
            station = taught_station(Path(folder) / "station", buffers=1)
            run_parts(station, _RECORDED_PART + 1, recorder.listen)
    finally:
        threading.setprofile(None)
    return recorder.calls()


def main(arguments: Sequence[str]) -> int:
    """Print the table; return 1 beyond a limit."""
    parser = argparse.ArgumentParser(prog="way_of_a_frame")
    parser.add_argument("--list", action="store_true", help="print the functions too")
    calls = recorded_calls()
    if parser.parse_args(arguments).list:
        print("\n".join(f"{path:52} {name}" for path, name in calls))
    files = {path for path, _ in calls}
    functions_in = Counter(str(Path(path).parent) for path, _ in calls)
    files_in = Counter(str(Path(path).parent) for path in files)
    for folder, functions in sorted(functions_in.items()):
        print(f"{folder:36} {functions:4} functions in {files_in[folder]:3} files")
    print(f"{'all':36} {len(calls):4} functions in {len(files):3} files")
    print(f"{'limit':36} {MOST_FUNCTIONS:4} functions in {MAX_FILES:3} files")
    return int(len(calls) > MOST_FUNCTIONS or len(files) > MAX_FILES)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
