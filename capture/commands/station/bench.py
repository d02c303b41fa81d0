"""``ps4rig station bench``."""

from typing import Annotated

import typer

from capture.base.console import out, print_json, reported
from capture.commands import options


@reported
def bench(
    parts: Annotated[int, typer.Option(min=10, max=1_000_000, help="Parts to judge.")] = 300,
    size: Annotated[int, typer.Option(min=256, max=8192, help="Side of the frames in px.")] = 1024,
    classes: Annotated[int, typer.Option(min=1, max=1000, help="Classes of the library.")] = 30,
    json: options.Json = False,
) -> None:
    """Measure how fast this machine judges parts, and whether memory grows.

    The cycle, the judge, the files and the results are those of a station; the sets are captured
    before. They are written to the folder for temporary files, TMPDIR.
    """
    from pathlib import Path
    from tempfile import TemporaryDirectory

    from capture.station.run.bench import run_bench

    def say(what: str) -> None:
        if not json:
            out.print(f"{what} ...")

    with TemporaryDirectory() as folder:
        report = run_bench(Path(folder), parts, size, classes, say)
    if json:
        print_json(
            {
                "parts": len(report.latencies_ms),
                "p50_ms": report.percentile_ms(50),
                "p99_ms": report.percentile_ms(99),
                "steps_ms": report.step_percentiles_ms(50),
                "steps_p99_ms": report.step_percentiles_ms(99),
                "parts_per_minute": report.parts_per_minute,
                "memory_mb": report.memory_mb,
                "verdicts": report.decisions,
            }
        )
        return
    for line in report.lines():
        out.print(line)
