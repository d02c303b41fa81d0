"""The command ``ps4rig bench``."""

from __future__ import annotations

from typing import Annotated

import typer

from capture.console import JsonOption, out, print_json, reported

__all__ = ["bench"]


@reported
def bench(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer rounds, no 100,000 references; a minute.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Measure this machine: ratios to a floor measured in the same run, with times beside them."""
    from capture.studies.benchmark.figures import as_json, print_chapter
    from capture.studies.benchmark.run import chapters, machine

    about = machine()
    if json:
        measured = [as_json(chapter) for chapter in chapters(quick)]
        print_json({"machine": about, "quick": quick, "chapters": measured})
        return
    out.print(
        f"{about['processor']}, {about['cores']} cores; ps4rig {about['ps4rig']}, "
        f"Python {about['python']}, numpy {about['numpy']}, numba {about['numba']}",
        soft_wrap=True,
    )
    for chapter in chapters(quick):
        print_chapter(chapter)
