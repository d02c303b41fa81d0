"""Commands that show what this package does: demo and reproduce."""

from pathlib import Path
from typing import Annotated

import typer

from capture.base.console import out

from . import options


def demo(
    output: Annotated[
        Path, typer.Option("--out", help="Folder for the report and the sets.", metavar="DIR")
    ] = Path("demo-report"),
    force: options.Force = False,
) -> None:
    """Capture, train and classify on the simulated rig, and write a report."""
    from capture.chapter.demo import run_demo

    run_demo(output, force=force)


def reproduce(
    output: Annotated[
        Path,
        typer.Option("--out", help="Folder for the page, pictures and CSV files.", metavar="DIR"),
    ],
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer textures and orientations; two minutes.")
    ] = False,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
) -> None:
    """Measure every figure and table of the thesis's chapter 9 on simulated surfaces."""
    from capture.chapter.exhibits import reproduce as run
    from capture.chapter.plan import plan_of

    page = run(plan_of(quick), output, workers, scheduler)
    out.print(f"{page}: every figure and table (simulated)")
