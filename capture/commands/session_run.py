"""Commands that plan and capture a session: session new, run, resume."""

from __future__ import annotations

import shutil
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import complain, out, print_json
from capture.base.outputs import check_output
from capture.commands import options
from classify.base.errors import InputError

if TYPE_CHECKING:
    from capture.session.folder import SessionFolder
    from capture.session.plan import SessionPlan
    from capture.session.preview_loop import Preview
    from rig import RigConfig


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
        read_plan(temporary)  # rejects a stem that cannot name a session
    out.print(f"{plan}: edit it, then run ps4rig session run {plan} --dry-run")


_Yes = Annotated[
    bool,
    typer.Option(
        "--yes", help="Ask nothing: for the simulated rig and turntables. What fails stays missing."
    ),
]
_NewPlan = Annotated[
    bool,
    typer.Option("--new-plan", help="Take the plan as it was edited since, without a question."),
]
# Margin on the disk space: a disk filled to the last byte is slow, and other programs write too.
_DISK_MARGIN = 1.1


def run(
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="The plan.")],
    rig: options.Rig = "rig.toml",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what the plan means, and capture nothing.")
    ] = False,
    yes: _Yes = False,
    new_plan: _NewPlan = False,
    json: options.Json = False,
) -> None:
    """Capture the sets of a plan that are missing, into a folder beside it.

    Stop with q or Ctrl-C at any time; ps4rig session resume goes on.
    """
    from capture.session.folder import make_session, read_session, session_folder
    from capture.session.plan import read_plan
    from capture.session.rig_checks import check_plan, search_warning
    from capture.sets.archive import JOURNAL
    from rig.config.rig import config_of

    config, session_plan = config_of(rig), read_plan(plan)
    check_plan(session_plan, plan, config)
    options.check_orientations(f"{plan}: orientations_deg", *session_plan.orientations_deg)
    path = plan.absolute().parent / session_plan.name
    if warning := search_warning(session_plan, config):
        complain(f"warning: {plan}: {warning}")
    if dry_run:
        missing = len(session_plan)
        if (path / JOURNAL).is_file():
            missing = len(read_session(path).missing(session_plan))
        _show_plan(plan, session_plan, missing, config, json=json)
        _check_disk(path.parent, missing * config.set_bytes)
        return
    if not (path / JOURNAL).is_file():
        _check_disk(path.parent, len(session_plan) * config.set_bytes)
    make_session(plan)
    with session_folder(path) as folder:
        if not _use_changed_plan(plan, folder, config, new_plan=new_plan, yes=yes):
            raise InputError(
                f"{plan}: differs from the plan of {path}; give --new-plan to take it, or go on "
                f"with the old one by ps4rig session resume {path}"
            )
        _capture_missing(folder, config, yes=yes, json=json)


def resume(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the session.")],
    rig: options.Rig = "rig.toml",
    yes: _Yes = False,
    new_plan: _NewPlan = False,
    left_out: Annotated[
        bool, typer.Option("--left-out", help="Capture the sets that were left out, too.")
    ] = False,
    json: options.Json = False,
) -> None:
    """Capture the missing sets of a session."""
    from capture.session.folder import session_folder
    from capture.session.plan_change import plan_beside
    from rig.config.rig import config_of

    config = config_of(rig)
    with session_folder(folder) as opened:
        try:
            plan = plan_beside(folder)
            if plan is None and new_plan:
                name = folder.absolute().name
                raise InputError(f"{folder}: no plan with name = {name!r} beside it")
            if plan is not None and not _use_changed_plan(
                plan, opened, config, new_plan=new_plan, yes=yes
            ):
                complain(
                    f"warning: {folder}: goes on with its old plan; ps4rig session resume {folder} "
                    "--new-plan takes the new one"
                )
        except InputError as error:
            if new_plan:
                raise
            complain(f"warning: {error}; {folder} goes on with its old plan")
        _capture_missing(opened, config, yes=yes, json=json, left_out=left_out)


def _use_changed_plan(
    source: Path, folder: SessionFolder, config: RigConfig, *, new_plan: bool, yes: bool
) -> bool:
    """Show the changes of a plan, and use it if the user agrees; False if not."""
    from capture.session.plan import read_plan
    from capture.session.plan_change import plan_changes, use_plan
    from capture.session.rig_checks import check_plan

    from .session_terminal import confirmed

    plan = read_plan(source)
    changes = plan_changes(plan, folder)
    if not changes:
        return True
    complain(f"{source} differs from the plan of {folder.path}:")
    for change in changes:
        complain(f"  {change}")
    can_ask = not yes and sys.stdin.isatty()
    if not new_plan and not (can_ask and confirmed("Use the changed plan from now on?")):
        return False
    check_plan(plan, source, config)
    use_plan(source, folder)
    for change in changes:
        folder.log(f"the plan was changed: {change}")
    return True


def _capture_missing(
    folder: SessionFolder, config: RigConfig, *, yes: bool, json: bool, left_out: bool = False
) -> None:
    from capture.session.events import without_questions
    from capture.session.live_view import LiveView
    from capture.session.runner import run_session

    from .session_terminal import SessionTerminal

    if not yes and not sys.stdin.isatty():
        raise InputError("there is no terminal to ask on; give --yes to run without questions")
    missing = len(folder.missing(left_out=left_out))
    _check_disk(folder.path, missing * config.set_bytes)
    with ExitStack() as stack:
        view = None if yes else LiveView(folder)
        if view is not None and missing:
            _serve(view.preview, stack)
        terminal = stack.enter_context(SessionTerminal(folder, missing, quiet=json, view=view))
        ask = without_questions if yes else terminal.ask
        finished = run_session(folder, config, ask, terminal.listen, left_out=left_out)
    if json:
        print_json(
            {
                "session": str(folder.path),
                "finish": finished.finish,
                "captured": finished.captured,
                "missing": finished.missing,
                "left_out": finished.left_out,
            }
        )
    if finished.missing:
        raise typer.Exit(1)


def _serve(preview: Preview, stack: ExitStack) -> None:
    """Serve the page that shows placements on the port of ``rig preview``, or on a free one."""
    from capture.session.preview_loop import serving

    try:
        server = stack.enter_context(serving(preview, options.PREVIEW_PORT))
    except InputError:
        server = stack.enter_context(serving(preview, 0))
    print(f"{server.url} shows how each specimen should lie, and how it lies", file=sys.stderr)


def _show_plan(
    path: Path, plan: SessionPlan, missing: int, config: RigConfig, *, json: bool
) -> None:
    """Show a plan, with the time and the disk space of the sets that are missing."""
    needed, capture_s = missing * config.set_bytes, _capture_s(missing, plan.average, config)
    free = shutil.disk_usage(path.absolute().parent).free
    if json:
        print_json(
            {
                "plan": plan.model_dump(mode="json"),
                "sets": len(plan),
                "missing": missing,
                "bytes": needed,
                "capture_s": round(capture_s, 1),
                "free_bytes": free,
            }
        )
        return
    for specimen in plan.specimen:
        surface = f", surface {specimen.surface}" if specimen.surface else ""
        out.print(f"{specimen.id}: class {specimen.label or specimen.id}{surface}")
    orientations = ", ".join(f"{angle_deg:g}" for angle_deg in plan.orientations_deg)
    repeats = f", {plan.repeats} sets each" if plan.repeats > 1 else ""
    out.print(f"each at {orientations} degrees{repeats}")
    sets = f"{len(plan)} sets"
    if missing < len(plan):
        sets += f" planned, {missing} missing"
    out.print(
        f"{sets}, {capture_s:.0f} s of capture and the time to place the part, "
        f"{needed / 1e6:.0f} MB of {free / 1e6:.0f} MB free",
    )


def _capture_s(sets: int, average: int, config: RigConfig) -> float:
    """Capture time: two ambient images; the LED switch costs a frame period an image."""
    images = len(config.lights.tilts_deg) + 2
    return sets * images * (1 + average) / config.camera.frame_rate_hz


def _check_disk(folder: Path, needed: int) -> None:
    free, needed = shutil.disk_usage(folder).free, int(needed * _DISK_MARGIN)
    if needed > free:
        raise InputError(
            f"{folder}: {free / 1e6:.1f} MB are free, the sets need {needed / 1e6:.1f} MB; make "
            "room, or plan fewer sets"
        )
