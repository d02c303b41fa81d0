"""The search for an exposure ends at the longest that fits into a frame."""

from pathlib import Path

import pytest

from capture import capture_set
from capture.session.rig_checks import find_exposure_ms
from classify.base.errors import InputError
from rig import RigConfig, open_rig


@pytest.mark.parametrize(("frame_rate_hz", "longest_ms"), [(30.0, 33.333), (60.0, 16.666)])
def test_a_dark_specimen_gets_the_longest_exposure(frame_rate_hz: float, longest_ms: float) -> None:
    config = RigConfig().with_changes(
        camera={
            "width_px": 64,
            "height_px": 64,
            "frame_rate_hz": frame_rate_hz,
            "exposure_ms": 4.0,
        },
        simulation={"ambient": 0.0, "led_levels": (0.02,) * 4},
    )
    assert find_exposure_ms(config) == longest_ms


def replaying(folder: Path, exposure_ms: float) -> RigConfig:
    """A camera whose exposure is fixed: it replays a set."""
    camera = {"width_px": 64, "height_px": 64, "exposure_ms": exposure_ms}
    path = folder / "set.ome.tif"
    with open_rig(RigConfig().with_changes(camera=camera)) as rig:
        capture_set(rig, is_target=True).save(path)
    replay = {"kind": "replay", "set_file": str(path), "exposure_ms": exposure_ms}
    return RigConfig().with_changes(camera=replay)


def test_a_fixed_exposure_stays_as_it_is_for_a_dark_specimen(tmp_path: Path) -> None:
    assert find_exposure_ms(replaying(tmp_path, 4.0)) == 4.0


def test_a_fixed_exposure_that_saturates_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"down to 30 ms"):
        find_exposure_ms(replaying(tmp_path, 30.0))
