"""Time of reading a set, of starting commands, and of batches of sets."""

import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from capture import CapturedSet
from capture.chapter.results import Work, shortest_ms, time_ms
from capture.sets.captured_set import PLANAR, LoadedSet
from classify import TextureLibrary
from classify.base.threads import set_thread_count, usable_processors
from classify.library.training import observe

from .measurements import Measurement, Section

_TARGETS_MS = {"reading a set": 3.0, "ps4rig --help": 200.0, "ps4rig classify SET": 1200.0}
# Largest ratio of a batch to reading and computing alone.
_MAX_OF_PARTS = 1.3
_ROUNDS = 20


def start_section(library: TextureLibrary, sets: int) -> Section:
    """Time commands, and batches of `sets` links to one set of 512 px."""
    with tempfile.TemporaryDirectory(prefix="ps4rig-speed-") as name:
        folder = Path(name)
        path, taught = folder / "one.ome.tif", folder / "taught.ps4lib"
        capture = "capture --rig sim --surface sand --rotate 33 --label sand --size 512"
        _ps4rig(*capture.split(), path)
        library.save(taught)
        commands: dict[str, Work] = {
            "reading a set": partial(LoadedSet.of, path),
            "ps4rig --help": partial(_ps4rig, "--help"),
            "ps4rig classify SET": partial(_ps4rig, "classify", path, "--library", taught),
        }
        times = shortest_ms(commands, _ROUNDS)
        found = [Measurement(step, times[step], "ms", target=_TARGETS_MS[step]) for step in times]
        batch = folder / "batch"
        batch.mkdir()
        for number in range(sets):
            os.link(path, batch / f"{number:06d}.ome.tif")

        def solve() -> object:
            return LoadedSet(CapturedSet.load(path), None).solve_texture(None, planar=PLANAR)

        set_thread_count(1)
        alone = shortest_ms(
            {
                "classify": lambda: library.classify(solve()),
                "train": lambda: observe(solve(), library.segment_px, library.classifier),
            },
            _ROUNDS,
        )
        set_thread_count(None)
        cores = len(usable_processors())
        for command, part in (
            ("classify", "classify"),
            ("evaluate", "classify"),
            ("train", "train"),
        ):
            output = folder / "new.ps4lib" if command == "train" else taught
            run = partial(_ps4rig, command, batch, "--library", output)
            ms = time_ms(run)
            ratio = ms / (sets * alone[part] / cores)
            step = f"ps4rig {command}, {sets} sets, to reading and computing"
            found.append(Measurement(step, ratio, "x", ms, _MAX_OF_PARTS))
    return Section(
        "Start and batches, 512 x 512", found, (f"The shortest of {_ROUNDS}; batches once.",)
    )


def _ps4rig(*arguments: object) -> None:
    command = [sys.executable, "-m", "capture", *map(str, arguments)]
    subprocess.run(command, check=True, capture_output=True)
