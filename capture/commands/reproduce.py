"""The command ``ps4rig reproduce``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from capture.console import SchedulerOption, WorkersOption, out, reported

__all__ = ["reproduce"]


@reported
def reproduce(
    output: Annotated[
        Path,
        typer.Option(
            "--out", help="Folder for the page, its pictures and CSV files.", metavar="DIR"
        ),
    ],
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer textures and orientations; about two minutes.")
    ] = False,
    materials: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the material folders for the table of scanned materials.",
            show_default="the materials of ps4rig",
            metavar="DIR",
        ),
    ] = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
) -> None:
    """Measure every figure and table of the thesis's chapter 9 on simulated surfaces."""
    from capture.studies.reproduction.experiments import material_textures, plan_of
    from capture.studies.reproduction.run import reproduce as run

    plan = plan_of(quick, material_textures(materials))
    page = run(plan, output, workers, scheduler)
    out.print(f"{page}: every figure and table (simulated)", soft_wrap=True)
