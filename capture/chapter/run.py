"""Measurement of a plan and its files."""

import itertools
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from capture.base.console import progress
from capture.batch.runner import Batch
from classify.base.durable_file import make_folder
from rig import SYNTHETIC_TEXTURES

from .exhibits import accuracy_exhibits, surface_exhibits
from .output import Exhibit, PageInfo, write_page
from .plan import Plan
from .results import Results, Trials, measured_costs, polar_spectra, sand_maps, shadow_shares
from .runs import match_patch, patch_tasks, train, training_tasks

_SHADOW_SLANTS_DEG = tuple(map(float, range(10, 90, 10)))  # figures 9.2 and 9.3
_POLAR_ORIENTATIONS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)  # figures 9.5 and 9.10
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def reproduce(
    plan: Plan, output: Path, workers: int | None = None, scheduler: str | None = None
) -> Path:
    """Measure a plan and write all files into a folder; returns the page."""
    make_folder(output)
    started_s = time.monotonic()
    results = _measure(plan, output, workers, scheduler)
    exhibits = list(_exhibits(results))
    facts = {
        "textures": f"{len(plan.thirty.textures)}",
        "frames": f"{plan.frame_px} px",
        "test patches": f"{sum(len(list(patch_tasks(e, output))) for e in plan.experiments)}",
        "answers": f"{sum(map(len, results.trials.values()))}",
        "duration": f"{(time.monotonic() - started_s) / 60.0:.1f} min on {os.cpu_count()} cores, "
        f"{platform.machine()}",
    }
    introduction = Path(__file__).with_name("chapter.html")
    info = PageInfo("reproduction", introduction, simulated=True, quick=plan.quick)
    return write_page(exhibits, facts, info, output)


def _measure(
    plan: Plan, output: Path, workers: int | None = None, scheduler: str | None = None
) -> Results:
    """Measure all numbers of a plan. The libraries are in a temporary folder in `output`."""
    # Workers read this when they start. With one worker on each core, BLAS threads wait for each
    # other, and texton histograms took eight times as long.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with (
        tempfile.TemporaryDirectory(dir=output.absolute(), prefix=".libraries-") as libraries,
        Batch(workers, scheduler) as batch,
    ):

        def run(
            function: Callable[[_Item], _Result], items: Sequence[_Item], name: str
        ) -> Iterator[_Result]:
            return progress(batch.map(function, items), len(items), name)

        folder = Path(libraries)
        shadows = list(itertools.product(SYNTHETIC_TEXTURES[:4], _SHADOW_SLANTS_DEG))
        shares = list(run(shadow_shares, shadows, "shadow"))
        spectra = partial(polar_spectra, size_px=2 * plan.frame_px)
        polar = list(run(spectra, _POLAR_ORIENTATIONS_DEG, "polar spectra"))
        (maps,) = run(sand_maps, [256], "maps")
        training = [
            task for experiment in plan.experiments for task in training_tasks(experiment, folder)
        ]
        for _ in run(train, training, "train"):
            pass
        tests = [
            task for experiment in plan.experiments for task in patch_tasks(experiment, folder)
        ]
        trials = Trials()
        for system, trial in itertools.chain.from_iterable(run(match_patch, tests, "test")):
            trials.setdefault(system, []).append(trial)
        costs = measured_costs(plan, folder)
    return Results(
        plan=plan,
        trials=trials,
        shadow_shares=dict(zip(shadows, shares, strict=True)),
        polar=dict(zip(_POLAR_ORIENTATIONS_DEG, polar, strict=True)),
        maps=maps,
        costs=costs,
    )


def _exhibits(results: Results) -> Iterator[Exhibit]:
    """Make all figures and tables in the order of the page."""
    summary, *accuracy = accuracy_exhibits(results)
    yield summary
    yield from sorted([*accuracy, *surface_exhibits(results)], key=lambda exhibit: exhibit.key)
