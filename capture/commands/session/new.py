"""``ps4rig session new``."""

from pathlib import Path
from typing import Annotated

import typer

from capture.base.console import out, reported
from capture.base.outputs import check_output
from capture.commands import options


@reported
def new(
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="The file to write.")],
    force: options.Force = False,
) -> None:
    """Write a commented example of a plan."""
    from capture.session.plan import example_plan, read_plan
    from classify.base.durable_file import durable_file

    check_output(plan, suffix=".toml", force=force)
    with durable_file(plan) as temporary:
        temporary.write_text(example_plan(plan.stem), encoding="utf-8")
        read_plan(temporary)  # a stem that cannot name a session is refused
    out.print(f"{plan}: edit it, then run ps4rig session run {plan} --dry-run")
