"""The command ``ps4rig bench``."""

from __future__ import annotations

from typing import Annotated

import typer

from capture.console import JsonOption, reported

__all__ = ["bench"]


@reported
def bench(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer rounds and references; about a minute.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Measure the speed of this machine: times, and ratios to a lower bound of the same run."""
    from capture.studies.benchmark.run import print_benchmark
    from capture.studies.benchmark.settings import FULL, QUICK

    print_benchmark(QUICK if quick else FULL, json)
