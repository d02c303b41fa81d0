"""``ps4rig session run`` and ``resume``."""

from __future__ import annotations

import shutil
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.commands import options
from capture.console import complain, out, print_json, reported
from classify.errors import InputError

if TYPE_CHECKING:
    from capture.preview.loop import Preview
    from capture.session.folder import SessionFolder
    from capture.session.plan import SessionPlan
    from rig import RigConfig

Yes = Annotated[
    bool,
    typer.Option(
        "--yes", help="Ask nothing: for the simulated rig and turntables. What fails stays missing."
    ),
]
# Bytes of a set beyond its pixels: metadata and the headers of pages.
_OVERHEAD_BYTES = 20_000
# A disk that is filled to the last byte is slow, and other programs write too.
_FREE_SHARE = 1.1


@reported
def run(
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="The plan.")],
    rig: options.Rig = "rig.toml",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what the plan means, and capture nothing.")
    ] = False,
    yes: Yes = False,
    json: options.Json = False,
) -> None:
    """Capture the sets of a plan that are missing, into a folder beside it.

    Stop with q or Ctrl-C at any time; ps4rig session resume goes on.
    """
    from capture.session.folder import (
        JOURNAL,
        make_session,
        plan_changes,
        read_session,
        session_folder,
        use_plan,
    )
    from capture.session.plan import read_plan
    from capture.session.rig_checks import check_plan, search_warning
    from rig.config.rig import config_of

    from .terminal import confirmed

    config, wanted = config_of(rig), read_plan(plan)
    check_plan(wanted, plan, config)
    options.check_orientations(f"{plan}: orientations_deg", *wanted.orientations_deg)
    path = plan.absolute().parent / wanted.name
    if warning := search_warning(wanted, config):
        complain(f"warning: {plan}: {warning}")
    if dry_run:
        missing = len(wanted)
        if (path / JOURNAL).is_file():
            missing = len(read_session(path).missing(wanted))
        _show_plan(plan, wanted, missing, config, json=json)
        return
    if not (path / JOURNAL).is_file():
        _check_disk(path.parent, _needed_bytes(len(wanted), config))
    make_session(plan)
    with session_folder(path) as folder:
        changes = plan_changes(plan, path)
        if changes:
            out.print(changes, soft_wrap=True)
            if yes or not sys.stdin.isatty():
                raise InputError(
                    f"{plan}: differs from the plan of {path}; run without --yes to confirm it "
                    f"on a terminal, or go on with ps4rig session resume {path}"
                )
            if not confirmed("Use the changed plan from now on?"):
                raise InputError(f"{plan}: differs from the plan of {path}, which stays as it is")
            use_plan(plan, folder)
            folder.log("the plan was changed")
        _go(folder, config, yes=yes, json=json)


@reported
def resume(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the session.")],
    rig: options.Rig = "rig.toml",
    yes: Yes = False,
    json: options.Json = False,
) -> None:
    """Capture the missing sets of a session."""
    from capture.session.folder import session_folder
    from rig.config.rig import config_of

    config = config_of(rig)
    with session_folder(folder) as opened:
        _go(opened, config, yes=yes, json=json)


def _go(folder: SessionFolder, config: RigConfig, *, yes: bool, json: bool) -> None:
    from capture.session.events import without_questions
    from capture.session.live_view import LiveView
    from capture.session.runner import run_session

    from .terminal import SessionTerminal

    if not yes and not sys.stdin.isatty():
        raise InputError("there is no terminal to ask on; give --yes to run without questions")
    _check_disk(folder.path, _needed_bytes(len(folder.missing()), config))
    with ExitStack() as stack:
        view = None if yes else LiveView(folder)
        if view is not None and folder.missing():
            _serve(view.preview, stack)
        terminal = stack.enter_context(SessionTerminal(folder, quiet=json, view=view))
        finished = run_session(
            folder, config, without_questions if yes else terminal.ask, terminal.listen
        )
    if json:
        print_json(
            {
                "session": str(folder.path),
                "finish": finished.finish,
                "captured": finished.captured,
                "missing": finished.missing,
            }
        )
    if finished.missing:
        raise typer.Exit(1)


def _serve(preview: Preview, stack: ExitStack) -> None:
    """Serve the page of the placements on the port of ``rig preview``, or on a free one."""
    from capture.preview.server import serving

    try:
        server = stack.enter_context(serving(preview, options.PREVIEW_PORT))
    except InputError:
        server = stack.enter_context(serving(preview, 0))
    print(f"{server.url} shows how each specimen should lie, and how it lies", file=sys.stderr)


def _show_plan(
    path: Path, plan: SessionPlan, missing: int, config: RigConfig, *, json: bool
) -> None:
    """Show a plan, with the time and the disk space of the sets that are missing."""
    needed, time_s = _needed_bytes(missing, config), _time_s(missing, plan.average, config)
    free = shutil.disk_usage(path.absolute().parent).free
    if json:
        counts = {"sets": len(plan), "missing": missing}
        costs = {"bytes": needed, "capture_s": round(time_s, 1), "free_bytes": free}
        print_json({"plan": plan.model_dump(mode="json"), **counts, **costs})
    else:
        for specimen in plan.specimen:
            surface = f", surface {specimen.surface}" if specimen.surface else ""
            out.print(f"{specimen.id}: class {specimen.label or specimen.id}{surface}")
        orientations = ", ".join(f"{each:g}" for each in plan.orientations_deg)
        repeats = f", {plan.repeats} sets each" if plan.repeats > 1 else ""
        out.print(f"each at {orientations} degrees{repeats}", soft_wrap=True)
        sets = f"{len(plan)} sets"
        if missing < len(plan):
            sets += f" planned, {missing} missing"
        out.print(
            f"{sets}, {time_s:.0f} s of capture and the time to place the part, "
            f"{needed / 1e6:.0f} MB of {free / 1e6:.0f} MB free",
            soft_wrap=True,
        )
    _check_disk(path.absolute().parent, needed)


def _needed_bytes(sets: int, config: RigConfig) -> int:
    camera, images = config.camera, len(config.lights.tilts_deg) + 1
    return sets * (2 * images * camera.width_px * camera.height_px + _OVERHEAD_BYTES)


def _time_s(sets: int, average: int, config: RigConfig) -> float:
    """Time of the frames: two ambient images, and two frame periods an image."""
    images = len(config.lights.tilts_deg) + 2
    return sets * images * (1 + average) / config.camera.frame_rate_hz


def _check_disk(folder: Path, needed: int) -> None:
    free, needed = shutil.disk_usage(folder).free, int(needed * _FREE_SHARE)
    if needed > free:
        raise InputError(
            f"{folder}: {free / 1e6:.1f} MB are free, the sets need {needed / 1e6:.1f} MB; make "
            "room, or plan fewer sets"
        )
