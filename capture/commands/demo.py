"""The command ``ps4rig demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from capture.console import reported

__all__ = ["demo"]


@reported
def demo(
    output: Annotated[
        Path, typer.Option("--out", help="Folder for the report and the sets.", metavar="DIR")
    ] = Path("demo-report"),
) -> None:
    """Capture, train and classify on the simulated rig, and write a report."""
    from capture.studies.demo.run import run_demo

    run_demo(output)
