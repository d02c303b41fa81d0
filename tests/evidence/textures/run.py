"""Measurement of the textures, and its files."""

import itertools
import os
import platform
import tempfile
import time
from pathlib import Path

from capture.base.console import progress
from capture.batch.runner import Batch
from capture.chapter.output import PageInfo, write_page
from capture.chapter.runs import System, patch_tasks, train, training_tasks
from classify.base.durable_file import make_folder

from .comparison import comparison_exhibits
from .days import days_exhibits
from .open_set import Outcome, match_patch
from .plan import TexturePlan
from .rejection import rejection_exhibits
from .results import TextureResults


def reproduce_textures(plan: TexturePlan, output: Path, workers: int | None = None) -> Path:
    """Measure a plan and write all files into a folder; returns the page."""
    make_folder(output)
    started_s = time.monotonic()
    results = TextureResults(plan, measure(plan, output, workers))
    exhibits = [
        *comparison_exhibits(results), *days_exhibits(results), *rejection_exhibits(results),
    ]  # fmt: skip
    material_sizes = ", ".join(str(test.conditions.size_px) for test in plan.materials.tests)
    facts = {
        "textures": f"{len(plan.synthetic.textures)} synthetic, "
        f"{len(plan.materials.textures)} materials, {len(plan.thirty.textures)} of the chapter",
        "frames": f"{plan.frame_px} px; materials {material_sizes} px; "
        f"robustness {plan.robustness.frame_px} px",
        "answers": f"{sum(map(len, results.outcomes.values()))}",
        "duration": f"{(time.monotonic() - started_s) / 60.0:.1f} min on {os.cpu_count()} cores, "
        f"{platform.machine()}",
    }
    introduction = Path(__file__).with_name("page.html")
    info = PageInfo("textures", introduction, simulated=True, quick=plan.quick)
    return write_page(exhibits, facts, info, output)


def measure(
    plan: TexturePlan, output: Path, workers: int | None = None
) -> dict[System, list[Outcome]]:
    """Train all libraries and match all test patches."""
    outcomes: dict[System, list[Outcome]] = {}
    with (
        tempfile.TemporaryDirectory(dir=output.absolute(), prefix=".libraries-") as libraries,
        Batch(workers) as batch,
    ):
        folder = Path(libraries)
        runs = [task for each in plan.experiments for task in training_tasks(each, folder)]
        for _ in progress(batch.map(train, runs), len(runs), "train"):
            pass
        tests = [task for each in plan.experiments for task in patch_tasks(each, folder)]
        matched = progress(batch.map(match_patch, tests), len(tests), "test")
        for outcome in itertools.chain.from_iterable(matched):
            outcomes.setdefault(outcome.system, []).append(outcome)
    return outcomes
