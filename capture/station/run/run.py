"""`run_station`: a station with its recipe, rig and results, from the start to the end."""

from collections.abc import Iterator

from capture.station.domain.folder import StationFolder
from capture.station.judge.inspector import COLLECTING_REASON
from capture.station.results.store import ResultStore, open_store
from rig import RigConfig
from rig.doctor.check import Check, run_checks

from .cycle import Station
from .equipment import Equipment, ReportAlive
from .events import PartRecovered, StationStopped, Warned
from .live_station import LiveStation
from .recovery import damaged_sets, finish_interrupted, require_own_sets, unknown_files
from .retention import retention_in_background
from .run_recipes import RunRecipes
from .self_test import check_disk, check_results
from .station_clock import StationClock
from .station_rig import StationRig
from .triggers import PartSensor, SensorTrigger, TriggerSource


def run_station(
    folder: StationFolder,
    rig_config: RigConfig,
    source: TriggerSource,
    live: LiveStation,
    *,
    operator: str | None = None,
    parts: int | None = None,
    report_alive: ReportAlive = lambda _: None,
    is_collecting: bool = False,
) -> StationStopped:
    """Run a station until its triggers end, or for `parts` parts.

    After Ctrl-C, the parts in progress are finished, and KeyboardInterrupt is raised. A run that
    `is_collecting` captures parts for teaching, and judges none.
    """
    config, clock = folder.config, StationClock()
    operator = operator or config.operator

    def warn(text: str) -> None:
        live.publish(Warned(text))

    with open_store(folder.results, config.name, create=not folder.has_sets()) as store:
        require_own_sets(folder, store)
        recipes = RunRecipes(folder, rig_config.calibration, operator, store, clock)
        if is_collecting:
            warn(COLLECTING_REASON)
            recipes.collect()
        else:
            recipes.begin(warn)
            live.publish(recipes.present.loaded_event)
        rig = StationRig(config, rig_config, recipes.present.inspector)
        for warning in (*damaged_sets(folder.path, store), *unknown_files(folder.path, store)):
            warn(warning)

        def prepare() -> list[Check]:
            return [
                *recipes.present.checks(),
                *_checks(folder, rig_config, store, live, clock),
            ]

        sensor = PartSensor(rig, store) if isinstance(source, SensorTrigger) else None
        equipment = Equipment(
            rig=rig,
            judge=recipes.present.judge,
            store=store,
            prepare=prepare,
            clock=clock,
            live=live,
            sensor=sensor,
            report_alive=report_alive,
            recipes=None if is_collecting else recipes,
        )
        with retention_in_background(folder.path, store, config.retention, warn):
            return Station(folder.path, config, equipment, parts).run(source)


def _checks(
    folder: StationFolder,
    rig_config: RigConfig,
    store: ResultStore,
    live: LiveStation,
    clock: StationClock,
) -> Iterator[Check]:
    """Check disk and database; then record and publish the parts that a killed run left behind."""
    floor_mb, set_size = folder.config.disk_floor_mb, rig_config.set_bytes
    yield from run_checks("disk", lambda: check_disk(folder.path, floor_mb, set_size), "disk")
    yield from check_results(store)
    for result in finish_interrupted(folder.path, store, clock.now):
        live.publish(PartRecovered(result))
