"""``ps4rig station challenge``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from capture.base.console import new_table, out, print_json, print_table, reports_errors
from capture.commands import options
from classify.base.errors import InputError

from .teach import By, Station

_Added = Annotated[
    list[Path] | None,
    typer.Option(
        help="Add this set and replay nothing. Repeat the option for more.", metavar="SET"
    ),
]
_Expected = Annotated[
    Literal["reject", "PASS", "FAIL", "UNKNOWN"] | None,
    typer.Option(
        help="The verdict that the added sets must get; reject: any but PASS.",
        show_default="reject",
    ),
]
_Removed = Annotated[
    list[str] | None,
    typer.Option(
        help="Take this part out and replay nothing. Repeat the option for more.", metavar="FILE"
    ),
]
_RecipeName = Annotated[
    str | None,
    typer.Option(help="The recipe.", show_default="the one with which the next run begins"),
]


@reports_errors
def challenge(
    folder: Station,
    add: _Added = None,
    expect: _Expected = None,
    remove: _Removed = None,
    recipe: _RecipeName = None,
    by: By = None,
    json: options.Json = False,
) -> None:
    """Replay the challenge set: stored parts, each with the verdict that it must get.

    After a change of the recipe, the library, the calibration or ps4rig, a station runs only if all
    parts get their verdicts. Taught parts with faults of a fifth of the frame, such as a hole or a
    stain, are judged too. The exit status is 1 if a part gets another verdict, or if such a fault
    passes and the recipe does not acknowledge it.
    """
    from capture.station.domain.folder import StationFolder, first_recipe
    from capture.station.judge.challenge import run_challenge
    from capture.station.judge.fault_study import large_faults
    from capture.station.judge.inspector import Inspector
    from capture.station.judge.recipe_changes import recipe_on_the_terminal

    if add is not None and remove is not None:
        raise InputError("--add and --remove: give one of them")
    if expect is not None and add is None:
        raise InputError("--expect: the verdict of added sets; give --add SET with it")
    name = recipe or first_recipe(StationFolder(folder))
    with recipe_on_the_terminal(folder, name, by) as changes:
        challenge_folder = changes.files.challenge
        if add is not None:
            expected = expect or "reject"
            changes.add_to_challenge(add, expected)
            out.print(f"{challenge_folder}: {len(add)} parts added that must be {expected}")
            return
        if remove is not None:
            for file in remove:
                changes.remove_from_challenge(file)
            out.print(f"{challenge_folder}: {len(remove)} parts taken out")
            return
    # A replay gets no row in the log of changes, so a new version of ps4rig can replay the set
    # while the old version runs the station.
    inspector = Inspector.load(changes.files, changes.calibration)
    replay = run_challenge(changes.files, inspector)
    faults = large_faults(changes.files, inspector)
    passed = not replay.regressions and not faults.passing(inspector.recipe)
    if json:
        print_json(replay.model_dump(mode="json") | {"passed": passed, "faults": faults.lines()})
    else:
        table = new_table("part", "must be", "is", "reason", prose="reason")
        for part in replay.parts:
            mark = "  <- REGRESSION" if part.is_regression else ""
            table.add_row(part.file, part.expected, f"{part.found}{mark}", part.reason)
        print_table(table)
        as_expected = len(replay.parts) - len(replay.regressions)
        out.print(f"{name}: {as_expected} of {len(replay.parts)} parts got the expected verdict")
        for line in faults.lines():
            out.print(line)
    if not passed:
        raise typer.Exit(1)
