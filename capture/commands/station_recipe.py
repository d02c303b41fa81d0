"""``ps4rig station teach``, ``challenge``, ``approve`` and ``roll-back``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from capture.base.console import complain, new_table, out, print_json, print_table, progress
from capture.base.utc_time import readable_utc
from capture.commands import options
from classify.base.errors import InputError

_DIGITS = 8  # of a hash that is shown

_RecipeName = Annotated[
    str | None,
    typer.Option("--recipe", help="The recipe.", show_default="that of station.toml"),
]
_By = Annotated[
    str | None,
    typer.Option(
        help="Who makes this change, for the log of changes.",
        metavar="NAME",
        show_default="the user of the system",
    ),
]
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
_NextRecipe = Annotated[
    str | None,
    typer.Option(help="The recipe.", show_default="the one with which the next run begins"),
]


def teach(
    folder: options.Station,
    sets: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[SET...]",
            help="Captured sets of good parts, and folders of them. Without any, the known sets "
            "are taught again, for example after a change of the region.",
        ),
    ] = None,
    recipe: _RecipeName = None,
    bad: Annotated[
        str | None,
        typer.Option("--as", help="These are bad parts, of this texture.", metavar="TEXTURE"),
    ] = None,
    label: Annotated[
        str | None,
        typer.Option("--label", help="These are good parts of this texture.", metavar="TEXTURE"),
    ] = None,
    relabel: Annotated[
        bool,
        typer.Option("--relabel", help="Sets that were taught already get the given texture."),
    ] = False,
    remove: Annotated[
        list[str] | None,
        typer.Option(
            "--remove",
            metavar="FILE",
            help="Teach without this file of recipes/NAME/sets. Repeat the option for more.",
        ),
    ] = None,
    by: _By = None,
    json: options.Json = False,
) -> None:
    """Teach good and bad parts: a new version of the recipe, which somebody must approve.

    The texture of good parts is --label, the label of their set, or the name of the recipe.
    """
    from capture.sets.archive import find_sets
    from capture.station.judge.recipe_changes import recipe_on_the_terminal

    if bad is not None and label is not None:
        raise InputError("--as and --label: give one of them")
    if relabel and not (sets and (bad or label)):
        raise InputError("--relabel: give sets, and their texture with --label or --as")
    with recipe_on_the_terminal(folder, recipe, by) as changes:
        teach_sets = changes.teaching(
            find_sets(sets) if sets else [],
            bad,
            label,
            is_relabelling=relabel,
            removed=remove or [],
        )
        teaching = teach_sets(progress)
    files = changes.files
    new_recipe = teaching.recipe
    if json:
        print_json(teaching.fields())
        return
    for remark in teaching.remarks:
        complain(f"warning: {remark}")
    for line in (*teaching.promises(), *teaching.least_found()):
        out.print(line)
    out.print(
        f"{files.file}: version {new_recipe.version}, not approved; see {teaching.files.report}, "
        f"then run ps4rig station approve {folder} --recipe {new_recipe.name} --by NAME",
    )


def approve(
    folder: options.Station,
    by: Annotated[str, typer.Option(help="Who approves it.", metavar="NAME")],
    recipe: _RecipeName = None,
) -> None:
    """Approve a recipe as it is now; any later change of it needs a new approval."""
    from capture.station.judge.recipe_changes import recipe_on_the_terminal

    with recipe_on_the_terminal(folder, recipe, by) as changes:
        approved = changes.approve(by)
    out.print(f"recipe {approved.name}, version {approved.version}: approved by {by}")


def roll_back(
    folder: options.Station,
    sha256: Annotated[
        str | None,
        typer.Argument(
            metavar="[HASH]",
            help="The first 8 characters or more of its hash; without it the states are listed.",
        ),
    ] = None,
    recipe: _RecipeName = None,
    by: _By = None,
) -> None:
    """Go back to a state of a recipe that was approved earlier, with its approval.

    What was taught later stays on disk. The challenge set must be met again before the recipe runs.
    """
    from capture.station.domain.recipe_file import read_recipe
    from capture.station.judge.approval import approved_states
    from capture.station.judge.recipe_changes import recipe_on_the_terminal, with_approval

    with recipe_on_the_terminal(folder, recipe, by) as changes:
        present, states = read_recipe(changes.files.file), approved_states(changes.files)
        if sha256 is not None:
            matching = [state.sha256 for state in states if _begins(state.sha256, sha256)]
            restored = changes.roll_back(matching[0] if len(matching) == 1 else sha256)
            out.print(f"recipe {restored.name}: {with_approval(restored)}")
            return
    table = new_table("version", "hash", "approved by", "approved", "")
    for state in states:
        if state.approval is not None:
            table.add_row(
                str(state.version),
                state.sha256[:_DIGITS],
                state.approval.by,
                readable_utc(state.approval.utc),
                "present" if state.sha256 == present.sha256 else "",
            )
    print_table(table)


def _begins(sha256: str, prefix: str) -> bool:
    return len(prefix) >= _DIGITS and sha256.startswith(prefix)


def challenge(
    folder: options.Station,
    add: _Added = None,
    expect: _Expected = None,
    remove: _Removed = None,
    recipe: _NextRecipe = None,
    by: _By = None,
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
