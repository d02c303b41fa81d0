"""Options and arguments that several commands share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from capture.base.console import complain
from classify.base.errors import InputError

if TYPE_CHECKING:
    from rig import RigConfig

SIMULATION = "With a simulated rig"
_MANY_SETS = "With many sets"
# Far more than any machine has cores; a typing error would exhaust its memory.
_MAX_WORKERS = 1024

PREVIEW_PORT = 8765

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Force = Annotated[
    bool, typer.Option("--force", help="Replace the output file if it exists already.")
]
Sets = Annotated[
    list[Path],
    typer.Argument(metavar="SET...", help="Captured sets, and folders with captured sets."),
]
Station = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the station.")]
Label = Annotated[str | None, typer.Option(help="Texture class of the part.")]
Specimen = Annotated[str | None, typer.Option(help="Which piece it is, such as fabric-07.")]
Operator = Annotated[str | None, typer.Option(help="Name of the operator.")]
Note = Annotated[str | None, typer.Option(help="Anything else that belongs to the set.")]

Orientation = Annotated[
    float | None,
    typer.Option(help="Orientation of the part, anticlockwise, if known.", metavar="DEG"),
]


def calibration_option(default: str) -> Any:
    """Make the option ``--calibration``, whose default is described by `default`."""
    return typer.Option(
        help="Calibration of the rig, NAME.ps4cal.", show_default=default, metavar="CAL"
    )


CalibrationOfSet = Annotated[Path | None, calibration_option("the one that the set names")]
Raw = Annotated[bool, typer.Option("--raw", help="Do not apply the calibration that a set names.")]


def check_calibration(calibration: Path | None, raw: bool) -> None:
    """Raise `InputError` if --calibration and --raw are both given."""
    if raw and calibration is not None:
        raise InputError("--raw applies no calibration; leave out --calibration or --raw")


Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=_MAX_WORKERS,
        help="Number of processes on this machine.",
        show_default="one per core",
        metavar="N",
        rich_help_panel=_MANY_SETS,
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        help="Address of a Dask scheduler whose workers see the same files: tcp://HOST:8786. "
        "The scheduler can run code on this machine: give one that you trust.",
        metavar="ADDRESS",
        rich_help_panel=_MANY_SETS,
    ),
]
Rig = Annotated[
    str, typer.Option("--rig", help="'sim' for the simulated rig, or a rig.toml.", metavar="RIG")
]
Surface = Annotated[
    str | None,
    typer.Option(
        help="A material folder or a name: rock, sand, malv, ogil and more, or a calibration "
        "target: plate, mirror_sphere, matte_sphere, checkerboard. A wrong name lists them all.",
        rich_help_panel=SIMULATION,
        metavar="NAME|DIR",
    ),
]
Slant = Annotated[
    float | None, typer.Option(help="Slant of the lights in degrees.", rich_help_panel=SIMULATION)
]
ShiftPx = Annotated[
    tuple[float, float] | None,
    typer.Option(help="Shift of the patch to the right and up.", rich_help_panel=SIMULATION),
]
Defects = Annotated[
    list[str] | None,
    typer.Option(
        "--defect",
        help="Defect of the part: scratch, dent, bump, stain, missing or foreign, X to the right "
        "and Y up from its middle, length or diameter, all in pixels; then the depth in pixels, "
        "the contrast of a stain, or the texture of a foreign patch. Repeat the option for more.",
        rich_help_panel=SIMULATION,
        metavar="KIND,X,Y,SIZE[,VALUE]",
    ),
]
Seed = Annotated[
    int | None,
    typer.Option(help="Seed of the noise and of a synthetic surface.", rich_help_panel=SIMULATION),
]
Bits = Annotated[
    int | None,
    typer.Option(help="Pixel depth of the camera: 8, 10, 12 or 16.", rich_help_panel=SIMULATION),
]
Size = Annotated[
    int | None, typer.Option(help="Side of the frame in pixels.", rich_help_panel=SIMULATION)
]


def defects(texts: list[str] | None) -> list[dict[str, Any]] | None:
    """Return the fields of `rig.Defect` for each --defect; the configuration checks the values."""
    return None if texts is None else [_defect(text) for text in texts]


def _defect(text: str) -> dict[str, Any]:
    from capture.base.names import typed_number

    kind, *values = (value.strip() for value in text.split(","))
    last_name = {"stain": "contrast", "foreign": "surface"}.get(kind, "depth_px")
    fields: dict[str, Any] = {"kind": kind}
    try:
        if not 3 <= len(values) <= 4:
            raise ValueError
        for name, value in zip(("x_px", "y_px", "size_px", last_name), values, strict=False):
            fields[name] = value if name == "surface" else typed_number(value)
    except ValueError:
        raise InputError(
            f"--defect {text}: give KIND,X,Y,SIZE or KIND,X,Y,SIZE,VALUE, such as "
            "scratch,0,20,40,1.5"
        ) from None
    return fields


def with_simulation(
    config: RigConfig,
    placement: dict[str, Any],
    slant_deg: float | None,
    bits: int | None,
    size_px: int | None,
) -> RigConfig:
    """Return `config` with the simulated part, lights and frame changed; None changes nothing."""
    camera = {"bits": bits, "width_px": size_px, "height_px": size_px}
    placed = config.simulation.placement.model_dump() | _without_none(placement)
    return config.with_changes(
        lights=_without_none({"slant_deg": slant_deg}),
        camera=_without_none(camera),
        simulation={"placement": placed},
    )


def _without_none(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def check_orientations(name: str, *degrees: float | None) -> None:
    """Refuse orientations of option `name` that are not finite; warn beyond 360 degrees."""
    for angle_deg in degrees:
        if angle_deg is not None and not math.isfinite(angle_deg):
            raise InputError(f"{name} {angle_deg:g}: give degrees, such as 40")
        if angle_deg is not None and abs(angle_deg) > 360.0:
            complain(f"warning: {name} {angle_deg:g}: beyond 360 degrees; a typing error?")


_MAX_DEG = 3600.0  # the limit of `Degrees` in a rig.toml


def degrees(option: str, text: str, example: str) -> list[float]:
    """Parse angles in degrees, separated by commas, of an option."""
    from capture.base.names import typed_number

    try:
        numbers = [typed_number(number) for number in text.split(",")]
    except ValueError:
        numbers = [math.nan]  # fails the comparison below
    if not all(abs(number) <= _MAX_DEG for number in numbers):
        entry = text or "''"
        raise InputError(f"{option} {entry}: give degrees separated by commas, such as {example}")
    return numbers
