"""``ps4rig station challenge``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from capture.commands import options
from capture.console import new_table, out, print_json, print_table, reported
from classify.errors import InputError

from .teach import RecipeName, Station


@reported
def challenge(
    folder: Station,
    add: Annotated[
        list[Path] | None,
        typer.Option(help="Captured set to add instead; may be given again.", metavar="SET"),
    ] = None,
    expect: Annotated[
        Literal["PASS", "FAIL", "UNKNOWN"] | None,
        typer.Option(help="The verdict that the added sets must get."),
    ] = None,
    recipe: RecipeName = None,
    json: options.Json = False,
) -> None:
    """Replay the challenge set: stored parts, each with the verdict that it must get.

    A changed recipe, library, calibration or version of ps4rig runs only after all got theirs. The
    exit status is 1 if one did not.
    """
    from capture.station.challenge import run_challenge
    from capture.station.challenge_set import add_to_challenge
    from capture.station.folder import StationFolder
    from capture.station.inspector import Inspector
    from rig.config.rig import config_of

    station = StationFolder(folder)
    files = station.recipe_files(recipe)
    if (add is None) != (expect is None):
        raise InputError("give --add SET and --expect PASS, FAIL or UNKNOWN together")
    if add is not None and expect is not None:
        add_to_challenge(files.challenge, add, expect)
        out.print(f"{files.challenge}: {len(add)} parts added that must be {expect}")
        return
    calibration = config_of(station.config.rig_in(folder)).calibration
    inspector = Inspector.load(files, None if calibration is None else Path(calibration))
    replay = run_challenge(files, inspector)
    if json:
        print_json(replay.model_dump(mode="json") | {"passed": not replay.regressions})
    else:
        table = new_table("part", "must be", "is", "reason", prose="reason")
        for part in replay.parts:
            mark = "  <- REGRESSION" if part.is_regression else ""
            table.add_row(part.file, part.expected, f"{part.found}{mark}", part.reason)
        print_table(table)
        met = len(replay.parts) - len(replay.regressions)
        out.print(f"{met} of {len(replay.parts)} parts got the verdict that they must get")
    if replay.regressions:
        raise typer.Exit(1)
