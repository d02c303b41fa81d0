"""``ps4rig station teach`` and ``approve``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from capture.commands import options
from capture.console import complain, out, print_json, reported

Station = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the station.")]
RecipeName = Annotated[
    str | None,
    typer.Option("--recipe", help="The recipe.", show_default="that of station.toml"),
]


@reported
def teach(
    folder: Station,
    sets: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[SET...]",
            help="Captured sets of good parts, and folders of them; none teaches the known sets "
            "again, after a change of the region.",
        ),
    ] = None,
    recipe: RecipeName = None,
    bad: Annotated[
        str | None,
        typer.Option("--as", help="These are bad parts, of this texture.", metavar="TEXTURE"),
    ] = None,
    json: options.Json = False,
) -> None:
    """Teach good and bad parts: a new version of the recipe, which somebody must approve.

    The texture of good parts is the label of their set, or the name of the recipe.
    """
    from capture.sets.archive import find_sets
    from capture.station.folder import StationFolder
    from capture.station.teaching import teach as teach_sets
    from capture.station.teaching_page import write_teaching_page

    files = StationFolder(folder).recipe_files(recipe)
    teaching = teach_sets(files, find_sets(sets) if sets else [], bad)
    write_teaching_page(teaching)
    made = teaching.recipe
    if json:
        print_json(teaching.fields())
        return
    for remark in teaching.remarks:
        complain(f"warning: {remark}")
    for promise in teaching.promises():
        out.print(promise, soft_wrap=True)
    out.print(
        f"{files.file}: version {made.version}, not approved; see {teaching.files.report}, then "
        f"run ps4rig station approve {folder} --recipe {made.name} --by NAME",
        soft_wrap=True,
    )


@reported
def approve(
    folder: Station,
    by: Annotated[str, typer.Option(help="Who approves it.", metavar="NAME")],
    recipe: RecipeName = None,
) -> None:
    """Approve a recipe as it is now; any later change of it needs a new approval."""
    from capture.station.approval import approve as approve_recipe
    from capture.station.folder import StationFolder

    approved = approve_recipe(StationFolder(folder).recipe_files(recipe), by)
    out.print(f"recipe {approved.name}, version {approved.version}: approved by {by}")
