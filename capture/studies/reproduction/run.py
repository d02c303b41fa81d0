"""From a plan to its files."""

from __future__ import annotations

import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import TypeVar

from capture.batch.runner import Batch
from capture.console import progress
from classify.durable_file import make_folder
from rig import SYNTHETIC_TEXTURES

from .chapter_accuracy import accuracy_exhibits
from .chapter_surface import surface_exhibits
from .comparison import comparison_exhibits
from .exams import exam_tasks, take_exam
from .exhibit import Exhibit
from .gallery import GALLERY_TURNS_DEG, GalleryTask, polar_spectra, sand_maps
from .output import write_exhibit, write_numbers, write_text
from .page import page
from .plan import Plan
from .rejection_exhibits import rejection_exhibits
from .results import Results
from .scenes import Texture
from .shadow_counts import ShadowTask, shadow_shares
from .tally import Tally
from .timing import measured_costs
from .training import train, training_tasks

__all__ = ["PAGE", "exhibits_of", "measure", "reproduce"]

PAGE = "reproduction.html"
NUMBERS = "results.json"

_SHADOW_SLANTS_DEG = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
Item = TypeVar("Item")
Result = TypeVar("Result")


def reproduce(
    plan: Plan, output: Path, workers: int | None = None, scheduler: str | None = None
) -> Path:
    """Measure all of a plan and write it into a folder; returns the page.

    Raises
    ------
    InputError
        If the folder cannot be made or written to, or no scheduler answers.
    """
    make_folder(output)
    started_s = time.monotonic()
    results = measure(plan, output, workers, scheduler)
    exhibits = list(exhibits_of(results))
    pictures = [
        (exhibit, write_exhibit(exhibit, output))
        for exhibit in progress(exhibits, len(exhibits), "draw")
    ]
    tests = sum(
        len(each.textures) * len(each.protocols) * len(each.turns_deg) for each in plan.experiments
    )
    facts = {
        "textures": f"{len(plan.synthetic.textures)} synthetic, "
        f"{len(plan.materials.textures)} materials, {len(plan.thirty.textures)} of the chapter",
        "frames": f"{plan.frame_px} px; materials "
        + ", ".join(f"{size_px}" for size_px in plan.material_sizes_px)
        + f" px; robustness {plan.robustness.frame_px} px",
        "test patches": f"{tests}",
        "answers": f"{results.tally.count}",
        "duration": f"{(time.monotonic() - started_s) / 60.0:.1f} min on {os.cpu_count()} cores, "
        f"{platform.machine()}",
    }
    about = {"version": version("ps4rig"), "simulated": True, "quick": plan.quick}
    write_numbers(exhibits, about, output / NUMBERS)
    write_text(output / PAGE, page(pictures, facts, plan.quick))
    return output / PAGE


def measure(
    plan: Plan, output: Path, workers: int | None = None, scheduler: str | None = None
) -> Results:
    """All numbers of a plan. The libraries lie in a folder within `output` meanwhile."""
    # Of each worker's BLAS, read when it starts. There is a worker for each core already, and
    # threads that wait for each other made texton histograms eight times slower.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with (
        tempfile.TemporaryDirectory(dir=output.absolute(), prefix=".libraries-") as libraries,
        Batch(workers, scheduler) as batch,
    ):

        def done(
            function: Callable[[Item], Result], items: Iterable[Item], what: str
        ) -> Iterator[Result]:
            listed = list(items)
            return progress(batch.map(function, listed), len(listed), what)

        folder = Path(libraries)
        size_px = 2 * plan.frame_px
        shadow_tasks = [
            ShadowTask(Texture(name), slant_deg, 512)
            for name in SYNTHETIC_TEXTURES[:4]
            for slant_deg in _SHADOW_SLANTS_DEG
        ]
        shares = list(done(shadow_shares, shadow_tasks, "shadow"))
        gallery = [GalleryTask(turn_deg, size_px) for turn_deg in GALLERY_TURNS_DEG]
        polar = list(done(polar_spectra, gallery, "polar spectra"))
        (maps,) = done(sand_maps, [GalleryTask(0.0, 256)], "maps")
        training = chain.from_iterable(training_tasks(each, folder) for each in plan.experiments)
        for _ in done(train, training, "train"):
            pass
        tests = chain.from_iterable(exam_tasks(each, folder) for each in plan.experiments)
        taken = list(done(take_exam, tests, "test"))
        costs = measured_costs(plan, folder)
    return Results(
        plan=plan,
        tally=Tally(answer for result in taken for answer in result.answers),
        rejections=[each for result in taken for each in result.rejections],
        shadow_shares={
            (task.texture.name, task.slant_deg): share
            for task, share in zip(shadow_tasks, shares, strict=True)
        },
        polar={task.turn_deg: each for task, each in zip(gallery, polar, strict=True)},
        maps=maps,
        costs=costs,
    )


def exhibits_of(results: Results) -> Iterator[Exhibit]:
    """All figures and tables, in the order of the page."""
    summary, *accuracy = accuracy_exhibits(results)
    yield summary
    yield from sorted([*accuracy, *surface_exhibits(results)], key=lambda each: each.key)
    yield from comparison_exhibits(results)
    yield from rejection_exhibits(results)
