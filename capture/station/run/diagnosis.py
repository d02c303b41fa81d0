"""The checks of ``ps4rig station doctor``: everything that a station needs to run."""

from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from capture.calibration.setting import Setting
from capture.station.domain.config import StationConfig
from capture.station.domain.folder import StationFolder, first_recipe
from capture.station.domain.own_folder import SECRETS, too_open
from capture.station.domain.recipe_file import RecipeFolder
from capture.station.judge.approval import approved_states
from capture.station.judge.inspector import Inspector
from capture.station.judge.recipe_state import state_of
from capture.station.results.chain import broken_links
from capture.station.results.store import open_store
from classify.base.errors import InputError
from rig import Rig
from rig.doctor.check import Check, Status, run_checks
from rig.doctor.diagnosis import diagnose

from .recovery import require_own_sets
from .self_test import check_calibration_age, check_disk, check_results, check_setting

_NEWEST_LINKS = 1000  # checked in 0.05 s


def diagnose_station(folder: Path) -> Iterator[Check]:
    """Yield all checks, which light the LEDs; a failed one does not prevent the next."""
    opened: list[StationFolder] = []  # one, or none if station.toml is invalid

    def check_config() -> Iterator[Check]:
        opened.append(StationFolder(folder))
        config = opened[0].config
        text = f"{config.name}: recipe {config.recipe}, rig {config.rig}, trigger {config.trigger}"
        yield Check("station.toml", "ok", text)

    yield from run_checks("station.toml", check_config)
    if not opened:
        return
    station = opened[0]
    yield from run_checks("permissions", lambda: _check_permissions(folder))
    yield from run_checks("disk", lambda: _check_disk(station))
    inspectors: list[Inspector] = []  # one, or none if the recipe cannot be loaded

    def check_recipe() -> Iterator[Check]:
        files = station.recipe_files(first_recipe(station))
        calibration = station.rig_config().calibration
        inspectors.append(Inspector.load(files, calibration))
        yield from _check_recipe(files, calibration)
        inspector = inspectors[0]
        yield from check_calibration_age(inspector.calibration, inspector.recipe.calibration)

    yield from run_checks("recipe", check_recipe)
    yield from run_checks("results", lambda: _check_results(station))
    yield from _check_extras(station.config)
    rig = station.rig
    if not inspectors:
        yield from diagnose(rig)
        return
    inspector = inspectors[0]
    camera = inspector.recipe.light.of_camera
    yield from diagnose(rig, more_checks=partial(_check_taught, inspector), camera=camera)


def _check_disk(station: StationFolder) -> Iterator[Check]:
    bytes_per_set = 0
    with suppress(InputError):  # the checks of the rig report an invalid rig.toml
        bytes_per_set = station.rig_config().set_bytes
    yield from check_disk(station.path, station.config.disk_floor_mb, bytes_per_set)


def _check_permissions(folder: Path) -> Iterator[Check]:
    open_paths = too_open(folder)
    if not open_paths:
        yield Check("permissions", "ok", "only the user of the station and its group can read it")
        return
    examples = ", ".join(str(path) for path in open_paths[:3])
    yield Check(
        "permissions",
        "warning",
        f"{len(open_paths)} files or folders are open to other users, such as {examples}",
        f"run chmod -R u=rwX,g=rX,o= {folder}, and chmod 600 for {', '.join(SECRETS)}",
    )


def _check_recipe(files: RecipeFolder, calibration: str | None) -> Iterator[Check]:
    state = state_of(files, calibration)
    recipe = state.recipe
    text = f"{recipe.name}, version {recipe.version}: passes {', '.join(recipe.passes)}"
    yield Check("recipe", "ok", f"{text}; fails {', '.join(recipe.fails) or 'no known texture'}")
    if recipe.is_approved:
        yield Check("approval", "ok", state.approval)
    else:
        # Until then an approved state of the recipe judges; without one the station does not run.
        status: Status = "warning" if approved_states(files) else "fault"
        yield Check("approval", status, state.approval, "run ps4rig station approve")
    if state.has_met_challenge:
        yield Check("challenge", "ok", state.challenge)
    else:
        advice = "run ps4rig station challenge; station run does so by itself"
        yield Check("challenge", "warning", state.challenge, advice)


def _check_taught(inspector: Inspector, rig: Rig) -> Iterator[Check]:
    """Check that the open rig is the one that the recipe was taught on."""
    faults = list(check_setting(inspector.faults_of(Setting.of_rig(rig))))
    yield from faults or [Check("taught rig", "ok", "camera, frame and lights are the taught ones")]


def _check_results(station: StationFolder) -> Iterator[Check]:
    results = station.results
    if "://" not in results and not Path(results).exists():
        yield Check("results", "ok", f"the first run makes {results}")
        return
    with open_store(results, station.config.name, exclusive=False) as store:
        require_own_sets(station, store)
        yield from check_results(store)
        broken_link = next(broken_links(store.reading, store.station, _NEWEST_LINKS), None)
        if broken_link is None:
            yield Check("chain of hashes", "ok", f"the last {_NEWEST_LINKS} rows are unaltered")
        else:
            yield Check("chain of hashes", "fault", broken_link, "run ps4rig verify")


def _check_extras(config: StationConfig) -> Iterator[Check]:
    """Check that the packages for the configured PLC and broker are installed."""
    for extra, package, is_needed in (
        ("modbus", "pymodbus", config.modbus is not None or config.trigger == "modbus"),
        ("mqtt", "paho", config.mqtt is not None),
    ):
        if is_needed and find_spec(package) is None:
            yield Check(extra, "fault", f"{package} is missing", f"pip install 'ps4rig[{extra}]'")
        elif is_needed:
            yield Check(extra, "ok", f"{package} is installed")
