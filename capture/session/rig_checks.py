"""The rig of a session: checks, comparison with its calibration, exposure, turntable."""

import math
import subprocess
from pathlib import Path

from capture.calibration.lookup import read_calibration
from capture.calibration.ps4cal import CalibrationFile
from capture.procedures.rig_check import checks_of_drift, drift_of_rig, lays_sheet_down
from capture.sets.ome_tiff import read_header
from classify.base.errors import CalibrationRejected, InputError
from classify.calibration.dark import Dark, measured_at
from rig import HardwareError, Rig, RigConfig, list_cameras, open_rig
from rig.doctor.check import Check
from rig.doctor.devices import exposure_range_ms
from rig.doctor.light_images import capture_light_images, rate_exposure
from rig.simulation.scenes import require_surface

from .events import Answer, Ask, PlaceSheet, Publish, RigCompared
from .folder import PLAN, SessionFolder
from .plan import SEARCH, SessionPlan


def check_rig(folder: SessionFolder, config: RigConfig) -> None:
    """Check that a rig can capture the missing sets of a session."""
    check_plan(folder.plan, folder.path / PLAN, config)
    _check_lights(folder, config)
    _check_frame(folder, config)


def check_plan(plan: SessionPlan, source: Path, config: RigConfig) -> None:
    """Check that a rig can capture a plan, which was read from `source`."""
    for specimen in plan.specimen:
        if not config.is_simulated and specimen.surface is not None:
            raise InputError(
                f"specimen {specimen.id}: surface is for the simulated rig only; remove the key"
            )
        if config.is_simulated and specimen.surface is None:
            raise InputError(
                f"specimen {specimen.id}: the simulated rig needs its surface; add surface = 'rock'"
            )
        if specimen.surface is not None:
            require_surface(specimen.surface)
    # This only validates the exposure.
    if plan.exposure_ms not in (None, SEARCH):
        config.with_changes(camera={"exposure_ms": plan.exposure_ms})
    if plan.calibration_required and config.calibration is None:
        raise InputError(
            f"{source}: calibration_required, but the rig names no calibration; make "
            "one with ps4rig calibrate, and set calibration = 'FILE.ps4cal' in rig.toml"
        )
    if config.calibration is not None:
        _check_calibration(read_calibration(Path(config.calibration)), config)
    exposure_ms = config.camera.exposure_ms if plan.exposure_ms is None else plan.exposure_ms
    dark = _dark_of(config)
    if dark is not None and exposure_ms != SEARCH and not dark.holds_at(float(exposure_ms)):
        raise InputError(
            f"{source}: exposure_ms = {exposure_ms:g}, but dark frames {measured_at(dark)} "
            f"({config.calibration}); set camera.exposure_ms = {exposure_ms:g} in rig.toml, then "
            "run ps4rig calibrate dark to add it"
        )


def _check_calibration(file: CalibrationFile, config: RigConfig) -> None:
    """Check a calibration against the rig and the frame of a configuration."""
    camera = config.camera
    if camera.recording is not None:  # a replay shows a recorded set, not this rig
        return
    rig_setting = {
        "rig_name": config.name,
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "bit_depth": camera.bits,
        "light_directions": tuple(map(tuple, config.lights.lighting.directions.tolist())),
    }
    causes = [
        cause
        for name, record in file.records.items()
        for cause in file.differences(name, record.setting.model_copy(update=rig_setting))
    ]
    if causes:
        raise InputError(
            f"{file.path}: the calibration does not hold for the rig: "
            f"{'; '.join(dict.fromkeys(causes))}; restore the setting, or calibrate again"
        )


def search_warning(plan: SessionPlan, config: RigConfig) -> str | None:
    """Return a warning if the exposure search can leave the range of the dark frames."""
    dark = _dark_of(config)
    if plan.exposure_ms != SEARCH or dark is None or dark.exposure_ms is None:
        return None
    return (
        f"exposure_ms = '{SEARCH}', but dark frames {measured_at(dark)} ({config.calibration}): "
        "sets at other exposures will be refused; set camera.exposure_ms in rig.toml to the "
        "shortest and then the longest exposure, and run ps4rig calibrate dark at each"
    )


def _dark_of(config: RigConfig) -> Dark | None:
    if config.calibration is None:
        return None
    return read_calibration(Path(config.calibration)).calibration.dark


def _check_lights(folder: SessionFolder, config: RigConfig) -> None:
    """Refuse a rig whose sets could not be compared with those of the session."""
    lights, session_lights = len(config.lights.tilts_deg), folder.journal.lights
    if session_lights not in (None, lights):
        raise InputError(
            f"{folder.path}: its sets have {session_lights} lights, the rig {config.name} has "
            f"{lights}; give --rig with the rig of the session, or another name in the plan for a "
            "new session"
        )


def _check_frame(folder: SessionFolder, config: RigConfig) -> None:
    """Refuse a rig whose frames differ in size from the first captured set of a specimen."""
    firsts = (folder.first_set_of(specimen.id) for specimen in folder.plan.specimen)
    first = next((path for path in firsts if path is not None), None)
    if first is None:
        return
    try:
        _, (rows, columns) = read_header(first)
    except InputError:
        return  # the run finds a damaged set and captures it again
    camera = config.camera
    if (camera.height_px, camera.width_px) != (rows, columns):
        raise InputError(
            f"{folder.path}: its sets have {columns} x {rows} px, the camera of the rig "
            f"{config.name} gives {camera.width_px} x {camera.height_px}; set it as before, or "
            "give another name in the plan for a new session"
        )


def rotate_specimen(plan: SessionPlan, orientation_deg: float) -> None:
    """Rotate the specimen to an orientation, if the plan has a turntable."""
    if plan.turntable is None:
        return
    command = plan.turntable_command(orientation_deg)
    try:
        subprocess.run(
            command, check=True, timeout=plan.turntable_timeout_s,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError) as error:
        raise HardwareError(f"turntable {' '.join(command)}: {_cause(error)}") from error


def _cause(error: OSError | subprocess.SubprocessError) -> str:
    if isinstance(error, subprocess.TimeoutExpired):
        return f"did not end within {error.timeout:g} s"
    if isinstance(error, subprocess.CalledProcessError):
        message = (error.stderr or b"").decode(errors="replace").strip()
        return f"ended with status {error.returncode}" + (f": {message[-200:]}" if message else "")
    return getattr(error, "strerror", None) or str(error)


# While images are saturated, each round tries 0.4 times the last exposure: the sixth tries 1/100 of
# the first.
_ROUNDS = 6
# Below the shortest exposure of common cameras, 0.02 ms.
_MIN_EXPOSURE_MS = 0.01


def find_exposure_ms(config: RigConfig) -> float:
    """Find an exposure in ms that `rate_exposure` calls good, from that of `config`.

    For a dark specimen, it is the longest that the camera allows.
    """
    listed = [] if config.is_simulated else list_cameras()
    exposure_ms = config.camera.exposure_ms
    for _ in range(_ROUNDS):
        with open_rig(config.with_changes(camera={"exposure_ms": exposure_ms})) as rig:
            rating = rate_exposure(capture_light_images(rig))
            shortest_ms, longest_ms = exposure_range_ms(rig.camera, listed, config.camera)
        if rating.is_good:
            return exposure_ms
        # Rounded down to whole microseconds, so as not to exceed the longest exposure; 1e-6 is for
        # floats that are just below a whole number.
        proposed_us = math.floor(1e3 * min(exposure_ms * rating.factor, longest_ms) + 1e-6)
        if rating.factor > 1.0 and proposed_us / 1e3 <= exposure_ms:
            return exposure_ms  # dark, but the longest already
        if proposed_us / 1e3 < max(shortest_ms, _MIN_EXPOSURE_MS):
            break
        exposure_ms = proposed_us / 1e3
    raise InputError(
        f"no exposure down to {exposure_ms:g} ms suits the specimen; dim the LEDs, or close the "
        "aperture"
    )


_NOT_COMPARED = Check(
    "sheet",
    "unknown",
    "the rig was not compared with its calibration",
    "run ps4rig rig doctor --sheet with a white sheet below the camera",
)


def compare_rig(rig: Rig, file: CalibrationFile, ask: Ask, publish: Publish) -> Answer:
    """Compare a rig with its calibration by a sheet; return GO if it agrees or the person skips.

    After a fault the person is asked again. A stop is returned before any fault, and raised as
    CalibrationRejected after one. A rig that lays the sheet down itself is compared once.
    """
    cause: str | None = None
    is_automatic = lays_sheet_down(rig)
    while True:
        answer = Answer.GO if is_automatic else ask(PlaceSheet(cause))
        if answer is Answer.SKIP:
            publish(RigCompared((_NOT_COMPARED,)))
            return Answer.GO
        if answer is Answer.STOP:
            if cause is None:
                return Answer.STOP
            raise CalibrationRejected(cause)
        try:
            checks = tuple(checks_of_drift(drift_of_rig(rig, file)))
        except CalibrationRejected as error:
            cause = str(error)
        else:
            faults = [
                f"{check.seen}: {check.advice}" for check in checks if check.status == "fault"
            ]
            if not faults:
                publish(RigCompared(checks))
                return Answer.GO
            cause = "; ".join(faults)
        if is_automatic:
            raise CalibrationRejected(cause)
