"""Shared by the commands of `calibrate`: targets, their sets, and the file that keeps a part."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from capture.base.console import complain, out, print_json
from capture.base.outputs import check_output
from classify.base.errors import InputError

if TYPE_CHECKING:
    from capture.calibration.ps4cal import CalibrationFile, MeasuredPart
    from capture.calibration.setting import PartName
    from capture.sets.captured_set import CapturedSet
    from capture.sets.photographs import Gamma, Photographs
    from rig import Rig

CalibrationPath = Annotated[
    Path,
    typer.Argument(
        metavar="CAL",
        help="Calibration file, NAME.ps4cal. One that exists gets this part added or replaced.",
    ),
]
RigToCalibrate = Annotated[
    str | None,
    typer.Option("--rig", help="'sim' for the simulated rig, or a rig.toml.", metavar="RIG"),
]


def from_files(help_text: str, metavar: str = "IMG|SET") -> Any:
    """Make the option ``--from``: files instead of a rig."""
    return typer.Option("--from", help=help_text, metavar=metavar)


PhotographGamma = Annotated[
    Literal["linear", "srgb"] | None,
    typer.Option(
        "--gamma", help="Coding of brightness of photographs, as for import; needed for JPEG."
    ),
]
Replace = Annotated[
    bool,
    typer.Option(
        "--replace", help="Take the new measurement also where the calibration has a better one."
    ),
]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask whether the target is in place.")]


@dataclass(frozen=True)
class Target:
    """The target of a procedure, below the camera."""

    name: str  # after "put", such as "a white matt sheet"
    surface: str  # as in `rig.Placement`
    size_mm: float | None = None  # diameter of a sphere, or side of a square of the checkerboard
    next_placement: str | None = None  # a request for each further placement


def calibration_at(path: Path, inputs: Sequence[Path] = ()) -> CalibrationFile:
    """Return the calibration that a part will be added to: that at `path`, or an empty one."""
    from capture.calibration.ps4cal import SUFFIX, CalibrationFile

    check_output(path, suffix=SUFFIX, inputs=inputs, force=True)
    return CalibrationFile.read(path) if path.exists() else CalibrationFile()


def source_files(sources: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Return the photographs and the sets among the files of ``--from`` and in its folders."""
    from capture.base.names import SET_SUFFIX
    from capture.sets.light_list import PHOTOGRAPH_SUFFIXES

    files: list[Path] = []
    for source in sources:
        photographs = [source]
        if source.is_dir():
            content = sorted(source.iterdir())
            photographs = [file for file in content if file.suffix.lower() in PHOTOGRAPH_SUFFIXES]
        if not photographs:
            raise InputError(f"{source}: holds no photographs ({', '.join(PHOTOGRAPH_SUFFIXES)})")
        files += photographs
    sets = [path for path in files if path.name.endswith(SET_SUFFIX)]
    return [path for path in files if path not in sets], sets


def photographs_or_sets(sources: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Return photographs and sets as `source_files`; one of the two lists is empty."""
    photographs, sets = source_files(sources)
    if photographs and sets:
        raise InputError("--from names photographs and sets; give one kind of them")
    return photographs, sets


def photographs_of(
    paths: Sequence[Path], gamma: Gamma | None, bits: int | None = None
) -> Photographs:
    """Read whole photographs, and print the warnings about them."""
    from capture.sets.photographs import read_photographs

    read = read_photographs(paths, gamma=gamma, bits=bits, crop=None)
    for warning in read.warnings:
        complain(f"warning: {warning}")
    return read


def captured_targets(
    rig: Rig, target: Target, rotations_deg: Sequence[float], average: int = 1, *, yes: bool
) -> Iterator[CapturedSet]:
    """Yield a set of a target for each of its placements.

    The simulated rig rotates the target to `rotations_deg`; a person is asked to move it.
    """
    from capture.acquisition.attempts import capture_set

    for number, rotate_deg in enumerate(rotations_deg):
        place_target(rig, target, rotate_deg, again=number > 0, yes=yes)
        yield capture_set(rig, average=average, is_target=True)


def place_target(
    rig: Rig,
    target: Target,
    rotate_deg: float = 0.0,
    shift_px: tuple[float, float] | None = None,
    *,
    again: bool = False,
    yes: bool = False,
) -> None:
    """Put a target below the camera of a simulated rig; at a real one, ask a person to do it."""
    simulation = rig.simulation
    if simulation is not None and simulation.placement is not None:
        change = {"surface": target.surface, "rotate_deg": rotate_deg, "size_mm": target.size_mm}
        if shift_px is not None:
            change["shift_px"] = shift_px
        simulation.place(simulation.placement.model_copy(update=change))
    elif not yes:
        request = f"put {target.name} under the camera"
        if again and target.next_placement is not None:
            request = target.next_placement
        ask(f"{request}, then press Enter")


def ask(request: str) -> None:
    """Print a request on stderr and wait for Enter; InputError if nobody can answer."""
    print(f"ps4rig: {request}: ", end="", file=sys.stderr, flush=True)
    if not sys.stdin.readline():
        raise InputError(f"nobody could be asked to {request}; give --yes if this is done")


def keep_parts(
    path: Path,
    file: CalibrationFile,
    parts: Sequence[MeasuredPart],
    *,
    replace: bool = False,
    json: bool,
    dropped: Collection[PartName] = (),
) -> CalibrationFile:
    """Write the calibration with parts added, replaced or dropped, and print their quality.

    Without `replace` a part that is better than the new one stays.
    """
    from capture.calibration.replacement import reason_to_keep, with_other_exposures

    is_new = not path.exists()
    if calibration_at(path).hash != file.hash:
        raise InputError(
            f"{path}: another program has changed it since this command began; run it again"
        )
    reasons = {part.name: None if replace else reason_to_keep(file, part) for part in parts}
    staying = file.records.keys() - {part.name for part in parts} - set(dropped)
    merged = file
    for name in dropped:
        merged = merged.without_part(name)
    for part in parts:
        for name in sorted(staying):
            # The scale depends on rig, camera and frame only.
            differences = file.records[name].setting.differences(part.record.setting, "scale")
            if differences:
                raise InputError(
                    f"{path}: its part {name} is of another rig: {'; '.join(differences)}; give "
                    "another file"
                )
        if reasons[part.name] is None:
            extended = with_other_exposures(part, file)
            merged = merged.with_part(part.name, extended.part, extended.record)
    merged.write(path)
    for warning in (*(text for part in parts for text in part.warnings), *merged.warnings()):
        complain(f"warning: {path}: {warning}")
    if json:
        answers = [_part_json(path, part, merged, reasons[part.name]) for part in parts]
        print_json(answers if len(answers) > 1 else answers[0])
        return merged
    for part in parts:
        record, title = merged.records[part.name], part.name.replace("_", " ")
        change = "replaced" if part.name in file.records else "added"
        if (reason := reasons[part.name]) is not None:
            change = f"of {record.date} kept, because {reason}; --replace takes the new one"
        out.print(f"{path}: {title} {change}. {record.quality}")
        for figure, value in record.figures.items():
            out.print(f"  {figure.replace('_', ' ')}: {value:.4g}")
    if is_new:
        out.print(f'a rig uses it by this line at the top of its rig.toml: calibration = "{path}"')
    return merged


def _part_json(
    path: Path, part: MeasuredPart, calibration: CalibrationFile, reason: str | None
) -> dict[str, Any]:
    """JSON of the part in the calibration; `reason` is why the new part was not taken."""
    record = calibration.records[part.name]
    return {
        "calibration": str(path), "part": part.name, "warnings": [*part.warnings],
        "kept_because": reason, "quality": record.quality, "figures": record.figures,
        "source": record.source, "calibration_id": calibration.hash,
    }  # fmt: skip
