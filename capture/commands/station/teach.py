"""``ps4rig station teach``, ``approve`` and ``roll-back``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from capture.base.console import (
    complain,
    new_table,
    out,
    print_json,
    print_table,
    progress,
    reports_errors,
)
from capture.base.utc_time import readable_utc
from capture.commands import options
from classify.base.errors import InputError

_DIGITS = 8  # of a hash that is shown

Station = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the station.")]
_RecipeName = Annotated[
    str | None,
    typer.Option("--recipe", help="The recipe.", show_default="that of station.toml"),
]
By = Annotated[
    str | None,
    typer.Option(
        help="Who makes this change, for the log of changes.",
        metavar="NAME",
        show_default="the user of the system",
    ),
]


@reports_errors
def teach(
    folder: Station,
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
    by: By = None,
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


@reports_errors
def approve(
    folder: Station,
    by: Annotated[str, typer.Option(help="Who approves it.", metavar="NAME")],
    recipe: _RecipeName = None,
) -> None:
    """Approve a recipe as it is now; any later change of it needs a new approval."""
    from capture.station.judge.recipe_changes import recipe_on_the_terminal

    with recipe_on_the_terminal(folder, recipe, by) as changes:
        approved = changes.approve(by)
    out.print(f"recipe {approved.name}, version {approved.version}: approved by {by}")


@reports_errors
def roll_back(
    folder: Station,
    sha256: Annotated[
        str | None,
        typer.Argument(
            metavar="[HASH]",
            help="The first 8 characters or more of its hash; without it the states are listed.",
        ),
    ] = None,
    recipe: _RecipeName = None,
    by: By = None,
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
