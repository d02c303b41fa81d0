"""Sets from a GigE Vision camera with faults: which are accepted, and whether any is wrong.

    python -m tests.evidence.genicam [--sets N]

The simulated rig's frames come over the loopback, as from `rig simulate --camera`. A set is wrong
if an image is not that of its light: more than 5 % off the simulated camera's own, rms.
"""

import argparse
import sys
import time
from collections import Counter

import numpy as np

from capture import CapturedSet, capture_set
from capture.base.errors import SetRejected
from rig import HardwareError, Rig, open_rig
from tests.gige_rig import GigeRig, gige_rig

CAMERA = {
    "width_px": 96, "height_px": 64, "bits": 16, "frame_rate_hz": 60.0, "exposure_ms": 8.0
}  # fmt: skip
# Lost packets of 1,000; the name says what happens between two sets, or who switches the lights.
FAULTS: dict[str, float] = {
    "none": 0.0,
    "0.1 % of packets lost": 1.0,
    "1 % of packets lost": 10.0,
    "5 % of packets lost": 50.0,
    "stale frames in the queue": 0.0,
    "exposure changed and restored": 0.0,
    "camera restarts": 0.0,
    "strobe, 1 % of packets lost": 10.0,
    "trigger": 0.0,
    "trigger, 1 % of packets lost": 10.0,
}
_MOST_DIFFERENCE = 0.05
_RESTARTS_EVERY = 10


def disturb(fault: str, rig: Rig) -> None:
    """Do what the name of a fault says before a set."""
    if fault.startswith("stale"):
        rig.lights.select(2)
        time.sleep(0.2)
    elif fault.startswith("exposure"):
        configured_ms = 1e3 * rig.camera.info.exposure_s
        rig.camera.set_exposure(0.5 * configured_ms)
        rig.camera.read(5.0)
        rig.camera.set_exposure(configured_ms)


def sets_with(fault: str, lost_packets: float, count: int) -> Counter[str]:
    """Capture `count` sets; return how they ended."""
    ends: Counter[str] = Counter()
    begins = (name for name in ("strobe", "trigger") if fault.startswith(name))
    with gige_rig(CAMERA, lost_packets, next(begins, "software")) as served:
        with open_rig(served.simulated) as ideal:
            truth = capture_set(ideal)
        while ends.total() < count:
            batch = min(_RESTARTS_EVERY, count - ends.total())
            # A busy machine is late with answers: then a device counts as lost.
            try:
                with open_rig(served.config) as rig:
                    for _ in range(batch):
                        disturb(fault, rig)
                        ends[_end(rig, truth)] += 1
                    if fault.endswith("restarts"):
                        _restart_within_a_set(served, rig, ends)
            except HardwareError:
                ends["device lost"] += 1
    return ends


def _end(rig: Rig, truth: CapturedSet) -> str:
    try:
        captured = capture_set(rig)
    except SetRejected:
        return "rejected"
    known = truth.images.astype(np.float32)
    difference = captured.images.astype(np.float32) - known
    rms = np.sqrt((difference**2).mean(axis=(1, 2))) / known.mean(axis=(1, 2))
    return "accepted" if rms.max() <= _MOST_DIFFERENCE else "WRONG"


def _restart_within_a_set(served: GigeRig, rig: Rig, ends: Counter[str]) -> None:
    served.restart()
    try:
        capture_set(rig)
    except (SetRejected, HardwareError):
        return
    ends["WRONG"] += 1


def main(arguments: list[str]) -> int:
    """Print a row for each fault; return 1 if a wrong set was accepted."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sets", type=int, default=500)
    count = -(-parser.parse_args(arguments).sets // len(FAULTS))
    columns = ("accepted", "rejected", "device lost", "WRONG")
    print(f"{'':32}" + "".join(f"{column:>13}" for column in columns))
    total: Counter[str] = Counter()
    for fault, lost_packets in FAULTS.items():
        ends = sets_with(fault, lost_packets, count)
        total += ends
        print(f"{fault:32}" + "".join(f"{ends[column]:13}" for column in columns), flush=True)
    print(f"{total.total()} sets, {total['WRONG']} wrong ones accepted (limit 0)")
    return int(total["WRONG"] > 0 or total["accepted"] == 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
