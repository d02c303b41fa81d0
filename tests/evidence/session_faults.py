"""The cost of a session, and the sets that it accepts from a rig with faults.

Measured at full length by the command below; CI runs a short form:
PS4RIG_TEXTURES=30 PS4RIG_ORIENTATIONS=18 PS4RIG_SIDE_PX=512 PS4RIG_FAULTS=300 pytest -m slow FILE
"""

import os
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from subprocess import Popen

import pytest

from capture import CapturedSet
from capture.session.events import SetFailed, without_questions
from capture.session.folder import SessionFolder, make_session, session_folder
from capture.session.runner import run_session
from rig import HardwareError, RigConfig, open_rig
from rig.scene.synthetic import SYNTHETIC_30
from tests.capture.acquisition.test_fault_matrix import TOLERANCE, error_of, random_set

TEXTURES = int(os.environ.get("PS4RIG_TEXTURES", "3"))
ORIENTATIONS = int(os.environ.get("PS4RIG_ORIENTATIONS", "3"))
SIDE_PX = int(os.environ.get("PS4RIG_SIDE_PX", "128"))
FAULTS = int(os.environ.get("PS4RIG_FAULTS", "40"))
Spawn = Callable[..., Popen[str]]


def plan_of(name: str, textures: int, orientations: int) -> str:
    """Return a plan of synthetic textures at even steps over 180 degrees."""
    angles = [180.0 * step / orientations for step in range(orientations)]
    specimens = ", ".join(
        f'{{id = "{each}", surface = "{each}"}}' for each in SYNTHETIC_30[:textures]
    )
    return f'name = "{name}"\norientations_deg = {angles}\nspecimen = [{specimens}]\n'


@pytest.mark.slow
def test_a_session_of_many_sets_is_complete(
    tmp_path: Path, spawn: Spawn, show_figures: Callable[[str], None]
) -> None:
    rig, plan = tmp_path / "rig.toml", tmp_path / "many.toml"
    rig.write_text(
        f'[lights]\nport = "simulated"\n[camera]\nwidth_px = {SIDE_PX}\nheight_px = {SIDE_PX}\n'
    )
    plan.write_text(plan_of("many", TEXTURES, ORIENTATIONS))
    begun_s, begun = time.monotonic(), os.times()
    process = spawn("session", "run", plan, "--rig", rig, "--yes")
    out, error = process.communicate()
    wall_s, ended = time.monotonic() - begun_s, os.times()
    cpu_s = ended.children_user - begun.children_user + ended.children_system
    cpu_s -= begun.children_system
    assert (process.returncode, error) == (0, ""), out
    session = SessionFolder(tmp_path / "many")
    sets = TEXTURES * ORIENTATIONS
    assert len(session.journal.entries) == sets
    said = [each for entry in session.journal.entries if entry.measures
            for each in entry.measures.warnings]  # fmt: skip
    show_figures(
        f"{TEXTURES} textures x {ORIENTATIONS} orientations of {SIDE_PX} x {SIDE_PX} px: "
        f"{wall_s:.0f} s of wall time, {cpu_s:.0f} s of processor time, "
        f"{1e3 * cpu_s / sets:.0f} ms of it a set, "
        f"{session.bytes_of_sets() / 1e6:.0f} MB, {len(said)} warnings"
    )
    # The simulated rig turns each part exactly.
    assert not [each for each in said if "the texture stands at" in each]


def is_wrong(captured: CapturedSet, config: RigConfig) -> bool:
    """Whether a set differs from what the rig shows without faults, as in test_fault_matrix.py."""
    placed = {"placement": captured.metadata.placement.model_dump()}  # type: ignore[union-attr]
    with open_rig(config.with_changes(simulation={"faults": None, **placed})) as clean:
        error = error_of(captured, clean)
    assert captured.metadata.checks is not None
    return error > max(TOLERANCE, 5.0 * (captured.metadata.checks.light_levels_error or 0.0))


@pytest.mark.slow
def test_a_session_on_a_rig_with_faults_accepts_no_wrong_set(
    tmp_path: Path, show_figures: Callable[[str], None]
) -> None:
    counts: Counter[str] = Counter()
    wrong = []
    for seed in range(FAULTS):
        kinds, config = random_set(seed)
        plan = tmp_path / f"faults-{seed}.toml"
        plan.write_text(plan_of(f"faults-{seed}", 2, 2))
        events: list[object] = []
        with session_folder(make_session(plan)) as folder:
            with suppress(HardwareError):
                run_session(folder, config, without_questions, events.append)
            entries = [entry for entry in folder.journal.entries if entry.file]
            counts["captured"] += len(entries)
            counts["missing"] += len(folder.missing())
            for entry in entries:
                captured = CapturedSet.load(folder.path / str(entry.file))
                if is_wrong(captured, config):
                    wrong.append((seed, kinds, entry.file))
        failed = sum(isinstance(event, SetFailed) for event in events)
        # What failed is missing, and nothing else, but for a rig that was lost.
        assert len(folder.missing()) >= failed
        counts["sessions with failures"] += failed > 0
    show_figures(f"{FAULTS} sessions on rigs with faults: {dict(counts)}, {len(wrong)} wrong")
    assert counts["captured"] > FAULTS
    assert counts["missing"] > 0
    assert wrong == []
