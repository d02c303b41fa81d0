"""Gauge study on a simulated rig: known parts, good and bad, each presented several times."""

import random
from collections.abc import Iterator

from capture.acquisition.attempts import capture_set
from capture.base.errors import CalibrationError, SetRejected
from capture.calibration.ps4cal import CalibrationFile
from capture.station.domain.config import SimulatedParts
from capture.station.domain.fault import fault_of
from capture.station.domain.simulated_parts import SimulatedPart, simulated_part
from capture.station.domain.verdict import Verdict
from classify.base.errors import ConfigError
from rig import Placement, Rig, RigConfig, open_rig

from .gauge import Presentation
from .inspector import Inspector

# Largest errors of putting a part back by hand, with the overlay of the preview.
_PLACEMENT_DEG, _PLACEMENT_PX = 2.0, 5.0
# A third to a half of the parts of a study should be bad (AIAG).
_SHARE_DEFECTIVE, _SHARE_OTHER = 0.4, 0.1


def known_parts(feed: SimulatedParts, count: int, frame_px: int) -> list[SimulatedPart]:
    """Return parts of the feed of a station, up to half of them bad."""
    shares = {
        "share_defective": _SHARE_DEFECTIVE if feed.defects else 0.0,
        "share_other": _SHARE_OTHER if feed.others else 0.0,
    }
    mixed = SimulatedParts.model_validate(feed.model_dump() | shares)
    return [simulated_part(mixed, number, frame_px) for number in range(1, count + 1)]


def present(
    parts: list[SimulatedPart],
    times: int,
    rig_config: RigConfig,
    inspector: Inspector,
    seed: int,
) -> Iterator[Presentation]:
    """Put each part below the camera of a simulated rig, `times` times, and judge it."""
    if not rig_config.is_simulated:
        raise ConfigError(
            "the rig is real; present known parts to ps4rig station run, and give their list"
        )
    draw = random.Random(seed)
    config = rig_config.with_changes(camera=inspector.recipe.light.of_camera)
    calibration = None if inspector.calibration is None else inspector.calibration.file
    with open_rig(config) as rig:
        for _ in range(times):
            for number, part in draw.sample([*enumerate(parts, 1)], len(parts)):
                assert rig.simulation is not None
                rig.simulation.place(_put_back(part.placement, draw))
                verdict = _verdict(rig, calibration, inspector)
                yield Presentation(f"part {number}", part.is_good, verdict.decision, verdict.reason)


def _put_back(placement: Placement, draw: random.Random) -> Placement:
    x_px, y_px = placement.shift_px
    return placement.model_copy(
        update={
            "rotate_deg": placement.rotate_deg + draw.uniform(-_PLACEMENT_DEG, _PLACEMENT_DEG),
            "shift_px": (
                x_px + draw.uniform(-_PLACEMENT_PX, _PLACEMENT_PX),
                y_px + draw.uniform(-_PLACEMENT_PX, _PLACEMENT_PX),
            ),
        }
    )


def _verdict(rig: Rig, calibration: CalibrationFile | None, inspector: Inspector) -> Verdict:
    try:
        return inspector.inspect(capture_set(rig, calibration=calibration)).verdict
    except (SetRejected, CalibrationError) as error:
        return fault_of(error).verdict
