"""``ps4rig calibrate show``."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import new_table, out, print_json, print_table
from capture.base.outputs import check_output
from capture.commands import options

if TYPE_CHECKING:
    from capture.calibration.ps4cal import CalibrationFile

    from .calibrate_page import Benefit

_PAGE_SUFFIX = ".html"


def show(
    path: Annotated[Path, typer.Argument(metavar="CAL", help="Calibration file, NAME.ps4cal.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="The page. One that exists is replaced.",
            show_default="NAME.html beside CAL; none with --json",
            metavar="PAGE.html",
        ),
    ] = None,
    json: options.Json = False,
) -> None:
    """Report quality, age, benefit and missing parts of a calibration; write a page."""
    from capture.calibration.ps4cal import CalibrationFile
    from classify.base.durable_file import write_text

    from .calibrate_page import benefit_of, calibration_page, summary_json

    page = output
    if page is None and not json and path.name:
        page = path.with_suffix(_PAGE_SUFFIX)
    if page is not None:
        check_output(page, suffix=_PAGE_SUFFIX, inputs=[path], force=True)
    file, now = CalibrationFile.read(path), datetime.now(UTC)
    benefit = benefit_of(file)
    if page is not None:
        write_text(page, calibration_page(path, file, benefit, now))
    if json:
        print_json(summary_json(path, file, benefit, now))
        return
    _print(file, benefit, now)
    out.print(f"{page}: maps, positions and curves")


def _print(file: CalibrationFile, benefit: Benefit, now: datetime) -> None:
    from .calibrate_page import part_summaries

    parts = part_summaries(file, now)
    table = new_table("part", "age", "quality", prose="quality")
    for part in parts:
        if part.record is not None:
            age = "-" if part.age_days is None else f"{part.age_days} days"
            table.add_row(part.title, age, part.record.quality)
    print_table(table)
    for part in parts:
        if part.record is None:
            out.print(f"missing: {part.title}, for {part.use}: {part.command}")
    if benefit:
        out.print("mean error of normals on a matt part, with the faults that were measured:")
        for name, degrees in benefit:
            out.print(f"  {name}: {degrees:.2f} degrees")
