"""A production with faults at random, and which verdicts its parts got.

    python -m tests.evidence.station.faults --parts 2000

Half of the parts have another texture than they should: one of them that passes is a wrong PASS.
"""

import argparse
import itertools
import os
import random
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

# The kernels run in one thread, so that other tests have the other cores.
os.environ |= {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

import cv2

from capture.station.domain.config import CONFIG
from capture.station.domain.folder import StationFolder
from capture.station.domain.simulated_parts import simulated_part
from capture.station.domain.verdict import Decision
from capture.station.run.events import PartAnnounced
from capture.station.run.live_view import LiveEvent
from classify.base.errors import Ps4rigError
from tests.capture.acquisition.test_fault_matrix import FAMILIES
from tests.capture.station.production import SMALL_RIG, run_parts, taught_station
from tests.capture.station.teaching_sets import SIDE_PX
from tests.evidence.station.memory_folder import in_memory

FEED = """[simulated_parts]
surfaces = ["rock"]
others = ["sand", "malv", "ogil"]
share_other = 0.5
share_defective = 0.0
"""
# Parts that share one plan of faults, and on the virtual clock the end of the self-test and the
# time that a part takes.
PARTS_OF_A_PLAN, TESTED_S, PART_S = 5, 0.2, 0.2
# Share of the plans whose faults are there from the start, not from one of the parts on.
SHARE_AT_START = 0.2
NOT_READY = "not ready"
COLUMNS = (
    *(f"{truth} {decision}" for truth in ("good", "other") for decision in Decision),
    NOT_READY,
)


def random_plan(chance: random.Random) -> tuple[list[str], dict[str, Any]]:
    """Draw one or two faults as the fault matrix of captures does; return their names and them."""
    begin_s = TESTED_S + PARTS_OF_A_PLAN * PART_S * chance.random()
    if chance.random() < SHARE_AT_START:
        begin_s = 0.0
    plan: dict[str, Any] = {"seed": chance.getrandbits(31)}
    names = []
    for family in chance.choices(list(FAMILIES), [1, 2, 2], k=chance.choice([1, 1, 2])):
        fault = FAMILIES[family](chance)
        when = fault if family == "leds" else fault["when"]
        if fault["kind"] != "swapped":  # which LEDs always are
            times = {"from_s": 0.0} | {key: when[key] for key in when if key.endswith("_s")}
            when |= {key: at_s + begin_s for key, at_s in times.items()}
        plan[family] = [*plan.get(family, []), fault]
        names.append(f"{family}: {fault['kind']}")
    return names, plan


def main(parts: int, seed: int) -> int:
    """Print the verdicts by fault; return the exit status."""
    cv2.setNumThreads(1)
    ends: dict[str, Counter[str]] = defaultdict(Counter)
    causes: Counter[str] = Counter()
    wrong: list[str] = []
    with tempfile.TemporaryDirectory(prefix="ps4rig-faults-", dir=in_memory(parts)) as place:
        folder = taught_station(Path(place) / "line-1")
        config = folder / CONFIG
        config.write_text(config.read_text().partition("[simulated_parts]")[0] + FEED)
        feed = StationFolder(folder).config.simulated_parts
        for number in itertools.count():
            if ends["all"].total() - ends["all"][NOT_READY] >= parts:
                break
            names, plan = random_plan(random.Random(f"{seed} {number}"))

            def count(end: str, names: list[str] = names) -> None:
                for name in (*names, "all"):
                    ends[name][end] += 1

            def listen(live: LiveEvent, names: list[str] = names, count: Any = count) -> None:
                if isinstance(live.event, PartAnnounced):
                    result = live.event.result
                    is_other = simulated_part(feed, result.number, SIDE_PX).is_other
                    count(f"{'other' if is_other else 'good'} {result.verdict.decision}")
                    if is_other and result.verdict.decision is Decision.PASS:
                        wrong.append(f"{result.part_id} with {names}: {result.verdict.reason}")

            try:
                run_parts(
                    folder,
                    PARTS_OF_A_PLAN,
                    listen,
                    SMALL_RIG.with_changes(simulation={"faults": plan}),
                )
            except Ps4rigError as error:
                count(NOT_READY)
                causes[str(error).split(";")[0]] += 1
    print(f"{'':24}" + "".join(f"{column:>15}" for column in COLUMNS))
    for name, counts in sorted(ends.items()):
        print(f"{name:24}" + "".join(f"{counts[column]:15}" for column in COLUMNS))
    print(
        f"\n{NOT_READY}", *(f"{times:4} {cause}" for cause, times in causes.most_common()), sep="\n"
    )
    print(f"\n{len(wrong)} wrong PASS", *wrong, sep="\n")
    return int(bool(wrong) or ends["all"]["good PASS"] == 0)


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--parts", type=int, default=2000)
    options.add_argument("--seed", type=int, default=20260101)
    given = options.parse_args()
    sys.exit(main(given.parts, given.seed))
