"""A production on a disk that another program fills, and that has room again later.

    unshare --user --map-root-user --mount python -m tests.evidence.station.full_disk FOLDER

`FOLDER` must exist: a small file system is mounted there, which nobody else sees.
"""

import os
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

# The kernels of forked processes run in one thread.
os.environ |= {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

from tests.capture.station.production import contradictions, taught_station
from tests.evidence.station.forked_run import ForkedRun

_DISK_MB = 64


def main(place: Path) -> int:
    """Print what happened; return the exit status."""
    subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={_DISK_MB}m", "tmpfs", str(place)], check=True
    )
    folder = taught_station(place / "line-1", disk_floor_mb=1)
    run = ForkedRun.start(folder)
    try:
        run.read_until(3)
        filler = place / "filler"
        # Without a buffer, which would be written once more when the file is closed.
        with filler.open("wb", buffering=0) as file, suppress(OSError):
            while file.write(bytes(65536)):
                pass
        print("the disk is full")
        until_s = time.monotonic() + 3.0
        while time.monotonic() < until_s and not run.is_over:
            run.read(0.1)
        filler.unlink()
        run.read_until(run.announced() + 3)
    finally:
        run.kill()
    last = ForkedRun.start(folder, parts=3)
    last.wait()
    events = [*run.events, *last.events]
    wrong = list(contradictions(folder, events))
    parts = [event for event in events if event["event"] == "part"]
    print(*(f"{count} {end}" for end, count in Counter(p["decision"] for p in parts).items()))
    print(*{event["reason"] for event in events if event["event"] == "refused"}, sep="\n")
    print(*{part["reason"] for part in parts if "storage" in part["causes"]}, sep="\n")
    print(*wrong, sep="\n")
    print(f"{len(wrong)} lost, doubled or contradicted")
    return int(bool(wrong) or last.status != 0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
