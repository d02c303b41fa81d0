"""Whether a rig suits the plan of a session, and the sets that it has."""

from classify.errors import InputError
from rig import RigConfig

from .folder import PLAN, SessionFolder
from .plan import SEARCH


def check_rig(folder: SessionFolder, config: RigConfig) -> None:
    """Check that a rig can capture what is missing of a session.

    Raises
    ------
    InputError
        If the plan needs another rig, or the captured sets are those of another number of lights.
    """
    plan = folder.plan
    without = [each.id for each in plan.specimen if each.surface is None]
    with_surface = [each.id for each in plan.specimen if each.surface is not None]
    if config.is_simulated and without:
        raise InputError(
            f"specimen {without[0]}: the simulated rig needs its surface; add surface = 'rock'"
        )
    if not config.is_simulated and with_surface:
        raise InputError(
            f"specimen {with_surface[0]}: surface is for the simulated rig only; remove the key"
        )
    _check_lights(folder, config)
    if plan.exposure_ms not in (None, SEARCH):
        config.with_changes(camera={"exposure_ms": plan.exposure_ms})
    if plan.calibration_required and config.calibration is None:
        raise InputError(
            f"{folder.path / PLAN}: calibration_required, but the rig names no calibration; make "
            "one with ps4rig calibrate, and set calibration = 'FILE.ps4cal' in rig.toml"
        )


def _check_lights(folder: SessionFolder, config: RigConfig) -> None:
    """Refuse a rig whose sets could not be compared with those of the session."""
    lights, known = len(config.lights.tilts_deg), folder.journal.lights
    if known not in (None, lights):
        raise InputError(
            f"{folder.path}: its sets have {known} lights, the rig {config.name} has {lights}; "
            "give --rig with the rig of the session, or another name in the plan for a new session"
        )
