"""The runner of a session: place, capture, check, keep, set after set."""

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from functools import partial
from importlib.metadata import version
from itertools import groupby
from pathlib import Path

from capture.acquisition.attempts import capture_set
from capture.base.errors import SetRejected
from capture.base.utc_time import utc_text
from capture.calibration.lookup import FoundCalibration, keep_beside
from capture.sets.captured_set import CapturedSet, LoadedSet, calibration_of
from capture.sets.description import described
from classify.base.errors import InputError, Ps4rigError
from rig import HardwareError, Placement, Rig, RigConfig, open_rig

from . import events
from .events import Answer, Ask, Publish
from .folder import SessionFolder
from .journal import FinishReason, RunRecord, SetEntry
from .measures import SpecimenReference, enter_corrections, measures_of
from .plan import SEARCH, PlannedSet
from .plan_change import rig_changes, rig_settings
from .rig_checks import check_rig, compare_rig, find_exposure_ms, rotate_specimen


class _End(Exception):  # noqa: N818 - also of a complete session
    """The end of a run, with the reason if it is not evident; raised to leave the loop of sets."""

    def __init__(
        self, finish: FinishReason, reason: str | None = None, error: Ps4rigError | None = None
    ) -> None:
        self.finish, self.reason, self.error = finish, reason, error


def run_session(
    folder: SessionFolder,
    config: RigConfig,
    ask: Ask,
    publish: Publish,
    *,
    left_out: bool = False,
) -> events.SessionFinished:
    """Capture the missing sets, each in its file, then in the journal, before the next begins."""
    run = RunRecord(
        started_utc=utc_text(),
        rig=config.name,
        settings=rig_settings(config),
        simulated=config.is_simulated,
        software_version=version("ps4rig"),
    )
    check_rig(folder, config)
    # Before the journal is written: with an unreadable calibration no run begins.
    new_runner = _Runner(folder, config, ask, publish, left_out)
    folder.reserve()
    if changes := rig_changes(folder.journal, config):
        publish(events.RigChanged(tuple(changes)))
    folder.update(folder.journal.with_run(run))
    with new_runner as runner:
        try:
            runner.read_again()
            runner.adopt()
            runner.compare_rig()
            runner.capture_all()
            end = _End("incomplete" if folder.missing() else "complete")
        except _End as raised:
            end = raised
        except KeyboardInterrupt:
            _end(folder, _End("interrupted"), publish, runner)
            raise
        except Ps4rigError as error:
            end = _End("failed", str(error), error)
    finished = _end(folder, end, publish, runner)
    if end.error is not None:
        raise end.error
    return finished


def _end(
    folder: SessionFolder, end: _End, publish: Publish, runner: "_Runner"
) -> events.SessionFinished:
    folder.release()
    folder.update(folder.journal.with_run_ended(utc_text(), end.finish, end.reason))
    missing, left_out = len(folder.missing()), len(folder.left_out())
    finished = events.SessionFinished(end.finish, end.reason, runner.captured, missing, left_out)
    publish(finished)
    return finished


class _Runner:
    """The open rig of a run, and the reference of the specimen below it."""

    def __init__(
        self,
        folder: SessionFolder,
        config: RigConfig,
        ask: Ask,
        publish: Publish,
        left_out: bool,
    ) -> None:
        self._folder, self._config = folder, config
        self._ask, self._publish, self._left_out = ask, publish, left_out
        self._closing = ExitStack()
        self._rig: Rig | None = None
        self._reference: tuple[Path, SpecimenReference] | None = None
        self._exposures_ms: dict[str, float] = {}
        self._calibration = FoundCalibration.of_rig(config.calibration)
        self.captured = 0

    def __enter__(self) -> "_Runner":
        return self

    def __exit__(self, *_: object) -> None:
        self._close_rig()

    def read_again(self) -> None:
        """Set damaged files aside, and enter corrections of the others in the journal."""
        planned_sets, intact = set(self._folder.plan.sets()), []
        for planned, state in self._folder.read_again():
            if isinstance(state, InputError):
                raise state
            entry = self._folder.journal.entry_of(planned)
            if isinstance(state, str):
                if planned in planned_sets:
                    self._folder.give_up(planned)
                    self._publish(events.SetDamaged(planned, state))
            elif entry is not None:
                intact.append((entry, state))
        enter_corrections(self._folder, intact)

    def adopt(self) -> None:
        """Enter the files that an earlier run wrote but could not enter into the journal."""
        for planned, captured in self._folder.orphans():
            path = self._folder.file_of(planned)
            shape = captured.images.shape[1:]
            calibration = calibration_of(path, captured.metadata, shape)
            entry = self._entry(planned, LoadedSet(captured, calibration))
            file = path.relative_to(self._folder.path).as_posix()
            entry = entry.model_copy(update={"file": file})
            self._folder.update(self._folder.journal.with_entry(entry))
            self._publish(events.SetAdopted(entry))

    def compare_rig(self) -> None:
        """Compare the rig with its calibration, if it has one, by a white sheet."""
        calibration_file = None if self._calibration is None else self._calibration.file
        if (
            calibration_file is None
            or calibration_file.calibration.flat_field is None
            or not self._missing()
        ):
            return
        self._rig = self._closing.enter_context(open_rig(self._config))
        if compare_rig(self._rig, calibration_file, self._ask, self._publish) is Answer.STOP:
            raise _End("stopped")

    def capture_all(self) -> None:
        """Capture the missing sets, placement after placement."""
        placements = [list(group) for _, group in groupby(self._missing(), key=_placement)]
        index, last = 0, None
        while index < len(placements):
            first = placements[index][0]
            match self._ask(events.PlaceSpecimen(first, partial(self._live_rig, first))):
                case Answer.STOP:
                    raise _End("stopped")
                case Answer.REPEAT:
                    # The previous placement once more, if there was one.
                    if last is not None:
                        self._capture_placement(last)
                    continue
                case Answer.SKIP:
                    self._leave_out(placements[index], "left out by the operator")
                case Answer.LEAVE:
                    pass
                case Answer.GO:
                    last = placements[index]
                    self._capture_placement(last)
            index += 1

    def _missing(self) -> list[PlannedSet]:
        return self._folder.missing(left_out=self._left_out)

    def _capture_placement(self, planned_sets: Sequence[PlannedSet]) -> None:
        rotate_specimen(self._folder.plan, planned_sets[0].orientation_deg)
        for planned in planned_sets:
            self._capture_one(planned)

    def _capture_one(self, planned: PlannedSet) -> None:
        while True:
            try:
                captured = self._captured(planned)
            except (SetRejected, HardwareError) as error:
                if self._decide_failure(planned, error) is Answer.REPEAT:
                    continue
                return
            path = self._folder.file_of(planned)
            if self._calibration is not None:  # before the first set is read with it
                keep_beside(self._calibration.file, path)
            entry = self._entry(planned, LoadedSet(captured, self._calibration))
            warnings = entry.measures.warnings if entry.measures else ()
            if warnings:
                answer = self._ask(events.DecideWarnings(planned, warnings))
                if answer is Answer.REPEAT:
                    continue
                if answer is Answer.SKIP:
                    self._leave_out([planned], "; ".join(warnings))
                    return
                if answer is Answer.STOP:
                    raise _End("stopped")
            if self._reference is not None and self._reference[0] == path:
                self._reference = None  # the first set of its specimen is replaced
            entered = self._folder.keep(planned, captured, entry)
            self.captured += 1
            self._publish(events.SetCaptured(entered))
            return

    def _decide_failure(self, planned: PlannedSet, error: Ps4rigError) -> Answer:
        """Ask what to do about a set that failed; a rig that failed is closed."""
        lost_rig = isinstance(error, HardwareError)
        if lost_rig:
            self._close_rig()
        self._publish(events.SetFailed(planned, str(error)))
        answer = self._ask(events.DecideFailure(planned, str(error), lost_rig))
        if answer is Answer.STOP:
            raise _End("failed", str(error), error) if lost_rig else _End("stopped")
        if answer is Answer.SKIP:
            self._leave_out([planned], str(error))
        return answer

    def _captured(self, planned: PlannedSet) -> CapturedSet:
        """Capture a set, with label and description from the plan."""
        specimen = self._folder.plan.specimen_named(planned.specimen)
        rig = self._opened(planned)
        captured = self._new_pixels(rig, specimen.label or specimen.id)
        return described(
            captured,
            specimen=specimen.id,
            operator=self._folder.plan.operator,
            note=specimen.note,
            orientation_deg=planned.orientation_deg,
            properties=specimen.properties,
        )

    def _new_pixels(self, rig: Rig, label: str) -> CapturedSet:
        """Capture a set whose pixels differ from those of all sets of the session.

        A simulated rig has the same noise after each start, so that a second set may be needed.
        """
        average = self._folder.plan.average
        calibration = None if self._calibration is None else self._calibration.file
        captured = capture_set(rig, label, average=average, calibration=calibration)
        if self._folder.journal.entry_with(captured.metadata.pixels_sha256) is None:
            return captured
        captured = capture_set(rig, label, average=average, calibration=calibration)
        same = self._folder.journal.entry_with(captured.metadata.pixels_sha256)
        if same is not None:
            raise SetRejected(
                f"every pixel is that of {same.file}: the camera repeats its images; restart it"
            )
        return captured

    def _entry(self, planned: PlannedSet, loaded: LoadedSet) -> SetEntry:
        """Measure a set against the first one of its specimen."""
        metadata = loaded.captured.metadata
        first, reference = self._folder.first_set_of(metadata.specimen or ""), None
        if first is not None:
            if self._reference is None or self._reference[0] != first:
                self._reference = first, SpecimenReference(LoadedSet.of(first))
            reference = self._reference[1]
        return SetEntry.of(planned, metadata, measures_of(loaded, reference))

    def _leave_out(self, planned_sets: Iterable[PlannedSet], reason: str) -> None:
        journal = self._folder.journal
        for planned in planned_sets:
            self._folder.set_aside(planned)
            journal = journal.with_entry(SetEntry.of(planned, skipped=reason))
        self._folder.update(journal)

    def _opened(self, planned: PlannedSet) -> Rig:
        """The rig with the exposure for a set; on a simulated rig with its specimen in place."""
        placement = None
        if self._config.is_simulated:
            placement = self._config.simulation.placement.model_copy(
                update={
                    "surface": self._folder.plan.specimen_named(planned.specimen).surface,
                    "rotate_deg": planned.orientation_deg,
                }
            )
        config = self._config_for(planned.specimen, placement)
        if self._rig is not None and self._rig.config.camera != config.camera:
            self._close_rig()
        if self._rig is None:
            self._rig = self._closing.enter_context(open_rig(config))
        simulation = self._rig.simulation
        if simulation is not None and placement is not None and simulation.placement != placement:
            simulation.place(placement)
        return self._rig

    def _live_rig(self, planned: PlannedSet) -> Rig:
        """The rig for live images; an exposure is not searched before the specimen is there."""
        if self._folder.plan.exposure_ms != SEARCH or planned.specimen in self._exposures_ms:
            return self._opened(planned)
        if self._rig is None:
            self._rig = self._closing.enter_context(open_rig(self._config))
        return self._rig

    def _config_for(self, specimen: str, placement: Placement | None) -> RigConfig:
        config = self._config
        if placement is not None:
            config = config.with_changes(simulation={"placement": placement.model_dump()})
        exposure_ms = self._folder.plan.exposure_ms
        if exposure_ms is None:
            return config
        if exposure_ms == SEARCH:
            if specimen not in self._exposures_ms:
                self._close_rig()
                self._exposures_ms[specimen] = find_exposure_ms(config)
            exposure_ms = self._exposures_ms[specimen]
        return config.with_changes(camera={"exposure_ms": exposure_ms})

    def _close_rig(self) -> None:
        self._rig = None
        self._closing.close()


def _placement(planned: PlannedSet) -> tuple[str, float]:
    return planned.specimen, planned.orientation_deg
