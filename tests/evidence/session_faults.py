"""The cost of a session, and the sets that it accepts from a rig with faults.

    python -m tests.evidence.session_faults [--quick]

A session of 30 textures at 18 orientations of 512 px, and 300 sessions on rigs with random faults.
--quick has 3 textures at 3 orientations of 128 px, and 12 rigs.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from capture import CapturedSet
from capture.session.events import SetFailed, without_questions
from capture.session.folder import SessionFolder, make_session, session_folder
from capture.session.runner import run_session
from rig import HardwareError, RigConfig, open_rig
from rig.scene.synthetic import SYNTHETIC_30
from tests.capture.acquisition.test_fault_matrix import TOLERANCE, error_of, random_set
from tests.capture.conftest import COMMAND

from .limits import at_least, at_most


def plan_of(name: str, textures: int, orientations: int) -> str:
    """Return a plan of synthetic textures at even steps over 180 degrees."""
    angles = [180.0 * step / orientations for step in range(orientations)]
    specimens = ", ".join(
        f'{{id = "{each}", surface = "{each}"}}' for each in SYNTHETIC_30[:textures]
    )
    return f'name = "{name}"\norientations_deg = {angles}\nspecimen = [{specimens}]\n'


def _complete(folder: Path, textures: int, orientations: int, side_px: int) -> bool:
    """Run a session by its command, on a rig without faults."""
    rig, plan = folder / "rig.toml", folder / "many.toml"
    rig.write_text(
        f'[lights]\nport = "simulated"\n[camera]\nwidth_px = {side_px}\nheight_px = {side_px}\n'
    )
    plan.write_text(plan_of("many", textures, orientations))
    begun_s, begun = time.monotonic(), os.times()
    subprocess.run([*COMMAND, "session", "run", plan, "--rig", rig, "--yes"], check=True)
    wall_s, ended = time.monotonic() - begun_s, os.times()
    cpu_s = ended.children_user - begun.children_user + ended.children_system
    cpu_s -= begun.children_system
    session = SessionFolder(folder / "many")
    said = [each for entry in session.journal.entries if entry.measures
            for each in entry.measures.warnings]  # fmt: skip
    sets = textures * orientations
    print(
        f"{textures} textures x {orientations} orientations of {side_px} x {side_px} px: "
        f"{wall_s:.0f} s of wall time, {cpu_s:.0f} s of processor time, "
        f"{1e3 * cpu_s / sets:.0f} ms of it a set, "
        f"{session.bytes_of_sets() / 1e6:.0f} MB, {len(said)} warnings"
    )
    # The simulated rig turns each part exactly.
    turned = [each for each in said if "the texture stands at" in each]
    are_met = [
        at_least("sets", len(session.journal.entries), sets),
        at_most("orientations doubted", len(turned), 0),
    ]
    return all(are_met)


def is_wrong(captured: CapturedSet, config: RigConfig) -> bool:
    """Whether a set differs from what the rig shows without faults, as in test_fault_matrix.py."""
    placed = {"placement": captured.metadata.placement.model_dump()}  # type: ignore[union-attr]
    with open_rig(config.with_changes(simulation={"faults": None, **placed})) as clean:
        error = error_of(captured, clean)
    assert captured.metadata.checks is not None
    return error > max(TOLERANCE, 5.0 * (captured.metadata.checks.light_levels_error or 0.0))


def _no_wrong_sets(folder: Path, rigs: int) -> bool:
    """Run sessions on rigs with random faults."""
    counts: Counter[str] = Counter()
    for seed in range(rigs):
        kinds, config = random_set(seed)
        plan = folder / f"faults-{seed}.toml"
        plan.write_text(plan_of(f"faults-{seed}", 2, 2))
        events: list[object] = []
        with session_folder(make_session(plan)) as session:
            with suppress(HardwareError):
                run_session(session, config, without_questions, events.append)
            entries = [entry for entry in session.journal.entries if entry.file]
            for entry in entries:
                if is_wrong(CapturedSet.load(session.path / str(entry.file)), config):
                    print(seed, kinds, entry.file)
                    counts["wrong"] += 1
            failed = sum(isinstance(event, SetFailed) for event in events)
            counts["captured"] += len(entries)
            counts["missing"] += len(session.missing())
            # What failed is missing, and nothing else, but for a rig that was lost.
            counts["failed but not missing"] += max(failed - len(session.missing()), 0)
    print(f"{rigs} sessions on rigs with faults: {dict(counts)}")
    are_met = [
        at_most("wrong sets", counts["wrong"], 0),
        at_most("failed but not missing", counts["failed but not missing"], 0),
        at_least("captured", counts["captured"], rigs),
        at_least("missing", counts["missing"], 1),
    ]
    return all(are_met)


def main(arguments: Sequence[str]) -> int:
    """Print the figures; return 1 if a session lacks a set or has a wrong one."""
    parser = argparse.ArgumentParser(prog="session_faults")
    parser.add_argument("--quick", action="store_true")
    is_quick = parser.parse_args(arguments).quick
    with tempfile.TemporaryDirectory() as folder:
        are_met = [
            _complete(Path(folder), *((3, 3, 128) if is_quick else (30, 18, 512))),
            _no_wrong_sets(Path(folder), 12 if is_quick else 300),
        ]
    return int(not all(are_met))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
