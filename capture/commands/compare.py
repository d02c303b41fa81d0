"""The command ``ps4rig compare``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import out, print_json, reported
from capture.base.outputs import check_output
from classify.base.errors import InputError

from . import options

if TYPE_CHECKING:
    from capture.maps.comparison import Comparison

_PAGE_SUFFIX = ".html"


@reported
def compare(
    first: Annotated[
        Path, typer.Argument(metavar="A", help="A captured set, or a folder of maps from solve.")
    ],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="PAGE.html", help="The page.", show_default="none, or comparison.html"
        ),
    ] = None,
    calibration: options.CalibrationOfSet = None,
    raw: options.Raw = False,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Compare two sets or folders of maps: maps side by side, distance and angle, what differs.

    Differences pixel by pixel are given where both have one size. With --json no page is written
    without --out.
    """
    from capture.maps.compared_side import side_of
    from capture.maps.comparison import compare as compared
    from capture.maps.comparison_page import comparison_page
    from classify.base.durable_file import durable_file

    options.check_calibration(calibration, raw)
    if (raw or calibration is not None) and first.is_dir() and second.is_dir():
        raise InputError(
            f"{first} and {second}: are solved already; leave out --calibration and --raw"
        )
    page = output if output is not None or json else Path(f"comparison{_PAGE_SUFFIX}")
    if page is not None:
        check_output(page, suffix=_PAGE_SUFFIX, inputs=[first, second], force=force)
    comparison = compared(*(side_of(path, calibration, raw=raw) for path in (first, second)))
    if page is not None:
        with durable_file(page) as temporary:
            temporary.write_text(comparison_page(comparison), encoding="utf-8")
    if json:
        print_json(comparison.as_json())
        return
    _print(comparison)
    out.print(f"{page}: maps side by side")


def _print(comparison: Comparison) -> None:
    texture, angle_deg = comparison.texture, comparison.angle_deg
    if texture is None:
        out.print("texture: not compared: a side is too small, or has no valid pixel")
    else:
        angle = "no clear angle" if angle_deg is None else f"{angle_deg:.1f} degrees"
        out.print(f"texture: distance {texture.distance:.2f}, {angle} from A to B")
    if comparison.normals_deg is not None and comparison.is_aligned:
        median, p95 = comparison.normals_deg
        out.print(f"normals: median {median:.3g} degrees apart, 95 % within {p95:.3g}")
    for name, difference in comparison.maps.items() if comparison.is_aligned else ():
        unit = f" {difference.unit}" if difference.unit else ""
        out.print(f"{name}: B - A has mean {difference.mean:.3g}, rms {difference.rms:.3g}{unit}")
    if comparison.maps and not comparison.is_aligned:
        out.print("the part was moved, or another one: pixels do not belong together")
    for field in comparison.fields:
        out.print(
            f"{field.field}: {field.first} -> {field.second}", markup=False,
        )  # fmt: skip
