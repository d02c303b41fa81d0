"""Measurement of detected defects, and its files."""

from __future__ import annotations

import os
import platform
import time
from pathlib import Path

from capture.base.console import progress
from capture.batch.runner import Batch
from capture.chapter.output import PageInfo, write_page
from classify.base.durable_file import make_folder

from . import learned
from .exhibits import defect_exhibits
from .measure import measure
from .plan import DefectPlan


def reproduce_defects(plan: DefectPlan, output: Path, workers: int | None = None) -> Path:
    """Measure all textures of a plan and write all files; returns the page.

    Raises
    ------
    InputError
        If the folder cannot be made or written to, or a material is too small.
    """
    make_folder(output)
    started_s = time.monotonic()
    tasks = [(plan, place) for place in range(len(plan.textures))]
    with Batch(workers, None) as batch:
        results = list(progress(batch.map(measure, tasks), len(tasks), "textures"))
    facts = {
        "textures": ", ".join(texture.name for texture in plan.textures),
        "parts": f"{max(plan.taught)} taught, {plan.good} good and {len(list(plan.cases))} "
        "defective ones of each texture",
        "learned features": "EfficientNet-Lite0" if learned.IS_INSTALLED else learned.IF_MISSING,
        "duration": f"{(time.monotonic() - started_s) / 60.0:.1f} min on {os.cpu_count()} cores, "
        f"{platform.machine()}",
    }
    introduction = Path(__file__).with_name("page.html")
    info = PageInfo("defects", introduction, simulated=True, quick=plan.quick)
    return write_page(list(defect_exhibits(plan, results)), facts, info, output)
