"""`run_station`: a station with its recipe, rig and results, from the start to the end."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from capture.calibration.lookup import FoundCalibration, keep_beside, read_calibration
from capture.sets.captured_set import CapturedSet
from classify.durable_file import make_folder
from rig import RigConfig
from rig.doctor.check import Check

from .challenge import require_challenge
from .collecting import COLLECTS, Collector
from .cycle import Station
from .events import PartRecovered, Publisher, RecipeLoaded, StationStopped, Warned
from .folder import StationFolder
from .inspector import Inspector
from .outcome import PartInspector, PartJudge
from .part_sensor import PartSensor
from .parts import Parts, Turned
from .recipe import Recipe, require_approved
from .recipe_file import read_recipe
from .recipe_folder import RecipeFolder
from .recovery import damaged_sets, finish_interrupted, unknown_files
from .results.store import ResultStore, open_store
from .retention_thread import retention_in_background
from .self_test import check_calibration_age, check_disk, check_judge, check_results
from .station_clock import StationClock
from .station_rig import StationRig
from .triggers import SensorTrigger, TriggerSource


@dataclass(frozen=True)
class RunOptions:
    """What a run differs in from the configuration of its station.

    Attributes
    ----------
    operator
        Who answers for the results.
    parts
        Number of parts after which the run ends; None for no end.
    turned
        As in `Parts`.
    is_collecting
        Whether parts are captured to be taught, and none is judged.
    """

    operator: str | None = None
    parts: int | None = None
    turned: Turned = lambda _: None
    is_collecting: bool = False


@dataclass(frozen=True)
class _Judging:
    """By what a run judges: the recipe, and what follows from it."""

    recipe: Recipe
    inspector: PartInspector
    calibration: FoundCalibration | None
    result_fields: dict[str, Any]
    checks: list[Check]


def run_station(
    folder: StationFolder,
    rig_config: RigConfig,
    source: TriggerSource,
    publisher: Publisher,
    options: RunOptions = RunOptions(),
) -> StationStopped:
    """Run a station until its triggers end.

    Raises
    ------
    InputError
        If recipe, library, calibration or results cannot be used, or the recipe is not approved or
        has no challenge set.
    ChallengeFailed
        If a part of the challenge set gets another verdict than it must.
    HardwareError
        If the rig cannot be opened, or the self-test finds a fault.
    ResultsUnavailable
        If the database does not answer.
    KeyboardInterrupt
        As it came, after the parts in progress.
    """
    config, clock = folder.config, StationClock()
    path = None if rig_config.calibration is None else Path(rig_config.calibration)
    make = _collecting if options.is_collecting else _judging
    judging = make(folder.recipe_files(), path, publisher)
    recipe = judging.recipe
    rig = StationRig(config, rig_config, recipe, judging.inspector.begin)

    def warn(text: str) -> None:
        publisher.publish(Warned(text))

    results = config.results_in(folder.path)
    with open_store(results, config.name, create=not folder.has_sets()) as store:
        for warning in (*damaged_sets(folder.path, store), *unknown_files(folder.path, store)):
            warn(warning)

        def prepare() -> list[Check]:
            return [*judging.checks, *_checks(folder, store, publisher, clock, rig, recipe)]

        judge = PartJudge(
            config.name,
            options.operator or config.operator,
            judging.inspector,
            judging.result_fields,
            lambda captured, set_file: _save(captured, folder.path / set_file, judging.calibration),
            clock,
        )
        sensor = PartSensor(rig, store) if isinstance(source, SensorTrigger) else None
        parts = Parts(rig, judge, store, prepare, clock, publisher, sensor, options.turned)
        with retention_in_background(folder.path, store, config.retention, warn):
            return Station(folder.path, config, parts, options.parts).run(source)


def _judging(files: RecipeFolder, calibration: Path | None, publisher: Publisher) -> _Judging:
    inspector = Inspector.load(files, calibration)
    recipe, fingerprint = inspector.recipe, inspector.fingerprint
    require_approved(recipe)
    require_challenge(files, inspector)
    publisher.publish(RecipeLoaded(recipe.name, recipe.version, recipe.sha256))
    fields = {
        "recipe": recipe.name,
        "recipe_version": recipe.version,
        "recipe_sha256": fingerprint.recipe_sha256,
        "library_sha256": fingerprint.library_sha256,
        "calibration_sha256": fingerprint.calibration_sha256,
    }
    checks = list(check_judge(files, inspector))
    return _Judging(recipe, inspector, inspector.calibration, fields, checks)


def _collecting(files: RecipeFolder, calibration: Path | None, publisher: Publisher) -> _Judging:
    """Nothing to judge by; a recipe that is there gives exposure and gain."""
    publisher.publish(Warned(COLLECTS))
    is_there = files.file.exists()
    recipe = read_recipe(files.file) if is_there else Recipe(name=files.name, passes=())
    found = None
    if calibration is not None:
        found = FoundCalibration(calibration, read_calibration(calibration), ())
    return _Judging(recipe, Collector(), found, {}, [])


def _checks(
    folder: StationFolder,
    store: ResultStore,
    publisher: Publisher,
    clock: StationClock,
    rig: StationRig,
    recipe: Recipe,
) -> Iterator[Check]:
    """All checks but those of the rig; interrupted parts get their results first."""
    yield from check_disk(folder.path, folder.config.disk_floor_mb)
    for result in finish_interrupted(folder.path, store, clock.now):
        publisher.publish(PartRecovered(result))
    yield from check_results(store)
    yield from check_calibration_age(rig.calibration, recipe.calibration)


def _save(captured: CapturedSet, path: Path, calibration: FoundCalibration | None) -> None:
    """Write the set of a part, with its calibration beside it."""
    make_folder(path.parent)
    if calibration is not None:
        keep_beside(calibration.path, calibration.file, path)
    captured.save(path, home=path.parent.parent)  # not the folder with all sets of the day
