"""The command ``ps4rig`` and its subcommands.

A command imports what it needs when it runs, so that ``--help`` answers at once.
"""

import logging
import shutil
import sys
from typing import Annotated

import typer

from classify.base.errors import InputError, Ps4rigError

from .base.console import add_commands, add_group, complain
from .base.interrupts import INTERRUPTED_STATUS
from .base.process_settings import configure_process
from .commands import (
    calibrate_camera,
    calibrate_lights,
    calibrate_scale,
    calibrate_show,
    info,
    rig_setup,
    rig_show,
    rig_timing,
    session_report,
    session_run,
    sets,
    solve,
    station_gauge,
    station_history,
    station_recipe,
    station_run,
    station_upkeep,
    station_users,
    studies,
    textures,
)
from .station.domain.own_folder import make_files_private

app = typer.Typer(
    pretty_exceptions_enable=False,
    # On a narrow terminal the boxes of rich help are too narrow for words.
    rich_markup_mode="rich" if shutil.get_terminal_size().columns >= 60 else None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
add_commands(
    app,
    {
        "demo": studies.demo,
        "capture": sets.capture,
        "import": sets.import_,
        "solve": solve.solve,
        "train": textures.train,
        "classify": textures.classify,
        "evaluate": textures.evaluate_,
        "info": info.info,
        "export": solve.export,
        "compare": info.compare,
        "verify": info.verify,
        "reproduce": studies.reproduce,
    },
)
add_group(
    app,
    "calibrate",
    "Measure a rig with a white sheet, a sphere or a checkerboard, and keep it in one file.",
    {
        "dark": calibrate_camera.dark,
        "lights": calibrate_lights.lights,
        "plate": calibrate_lights.plate,
        "response": calibrate_camera.response,
        "scale": calibrate_scale.scale,
        "show": calibrate_show.show,
    },
)
add_group(
    app,
    "rig",
    "Set up and check the rig itself, and switch its lights by hand.",
    {
        "init": rig_setup.init,
        "flash": rig_setup.flash,
        "doctor": rig_show.doctor,
        "lights": rig_show.lights,
        "latency": rig_timing.latency,
        "timing": rig_timing.timing,
        "preview": rig_show.preview,
        "simulate": rig_setup.simulate,
    },
)
add_group(
    app,
    "session",
    "Capture many sets by a plan, and go on where a session was interrupted.",
    {
        "new": session_run.new,
        "run": session_run.run,
        "status": session_report.status,
        "resume": session_run.resume,
        "report": session_report.report,
    },
)
_station = add_group(
    app,
    "station",
    "Inspect parts with a rig, one after the other, and keep every result.",
    {
        "init": station_upkeep.init,
        "teach": station_recipe.teach,
        "approve": station_recipe.approve,
        "roll-back": station_recipe.roll_back,
        "challenge": station_recipe.challenge,
        "run": station_run.run,
        "panel": station_run.panel,
        "history": station_history.history,
        "override": station_history.override,
        "gauge": station_gauge.gauge,
        "bench": station_gauge.bench,
        "doctor": station_upkeep.doctor,
        "unit": station_upkeep.unit,
        "backup": station_upkeep.backup,
        "restore": station_upkeep.restore,
    },
    make_files_private,
)
add_group(
    _station,
    "user",
    "The people who may use a station's panel.",
    {
        "add": station_users.add_user,
        "kiosk": station_users.set_kiosk,
        "remove": station_users.remove_user,
        "list": station_users.list_users,
    },
)
add_group(
    _station,
    "token",
    "The API clients: programs that may use a station's HTTP API.",
    {
        "add": station_users.add_token,
        "remove": station_users.remove_token,
        "list": station_users.list_tokens,
    },
)


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    show_version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False,
) -> None:
    """Four-light photometric stereo: capture a surface, find its texture and its orientation."""
    if show_version:
        from importlib.metadata import version

        print(f"ps4rig {version('ps4rig')}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())


def run() -> int:
    """Run the command that the process was started with; return its exit status."""
    # Silences tifffile's log of damaged files, which the error line repeats.
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)
    try:
        _check_arguments(sys.argv[1:])
        if sys.stderr.isatty():
            _show_compilation()
        configure_process()
        status = app(standalone_mode=False)
        return status if isinstance(status, int) else 0
    except Ps4rigError as error:
        complain(str(error))
        return error.exit_status
    except typer.Abort:  # of an interrupt outside the function of the command
        return INTERRUPTED_STATUS
    except Exception as error:
        # The public interface of typer has no class for its usage errors.
        message = getattr(error, "format_message", None)
        if message is None:
            raise
        complain(f"{message().rstrip('.')}; see --help")
        return InputError.exit_status


def _show_compilation() -> None:
    """Say why the first start after an installation takes a minute."""
    log, handler = logging.getLogger("classify.base.compiling"), logging.StreamHandler()
    handler.setFormatter(logging.Formatter("ps4rig: %(message)s"))
    log.addHandler(handler)
    log.setLevel(logging.INFO)


def _check_arguments(arguments: list[str]) -> None:
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError as error:
            raise InputError(
                f"argument {argument}: not valid UTF-8; use another text, or rename the file"
            ) from error
