"""A recipe that is taught with a calibration, and on a region of the image."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from capture import CapturedSet, capture_set
from capture.base.utc_time import utc_text
from capture.calibration.lookup import FoundCalibration, read_calibration
from capture.calibration.ps4cal import CalibrationFile, PartRecord
from capture.calibration.setting import Setting
from capture.station.domain.recipe import Recipe, Region
from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from capture.station.domain.verdict import Cause, Decision
from capture.station.judge.challenge import require_challenge
from capture.station.judge.challenge_set import add_to_challenge
from capture.station.judge.inspector import Inspector
from capture.station.judge.teaching.teaching import teach
from capture.station.run.self_test import check_calibration_age
from classify.calibration.flat_field import PlateBlocks, fit_flat_field
from classify.images import ImageStack
from rig import Placement, RigConfig, open_rig
from rig.config.simulation import Defect

REGION = Region(x=128, y=100, width=256, height=272)
FRAME_PX = 400


def calibrated_with(flat: object, setting: Setting, date: str) -> CalibrationFile:
    record = PartRecord(setting=setting, quality="", source=("captured",), date=date)
    return CalibrationFile().with_part("flat_field", flat, record)


@pytest.mark.slow
def test_a_calibrated_recipe_judges_its_region(tmp_path: Path) -> None:
    config = RigConfig().with_changes(
        camera={"width_px": FRAME_PX, "height_px": FRAME_PX},
        simulation={"led_levels": (1.0, 0.9, 1.05, 0.85), "placement": {"surface": "plate"}},
    )
    calibration = tmp_path / "rig.ps4cal"
    sets: list[Path] = []
    with open_rig(config) as rig:
        plate = capture_set(rig, average=4, is_target=True)
        blocks = PlateBlocks.of(
            [ImageStack(plate.images, plate.ambient)], plate.metadata.full_scale
        )
        flat, setting = fit_flat_field(blocks).flat_field, Setting.of_rig(rig)
        file = calibrated_with(flat, setting, plate.metadata.created_utc)
        file.write(calibration)
        for number in range(4):
            place = Placement(surface="rock", shift_px=(500.0 * number, 0.0))
            rig.simulation.place(place)
            sets.append(tmp_path / f"rock-{number}.ome.tif")
            capture_set(rig, label="rock", calibration=file).save(sets[-1])
        # 40 px to the right of the frame's centre and 30 px below it.
        stain = Defect(kind="stain", x_px=540.0, y_px=-30.0, size_px=30.0, contrast=0.6)
        rig.simulation.place(Placement(surface="rock", shift_px=(500.0, 0.0), defects=(stain,)))
        stained = capture_set(rig, label="rock", calibration=file)
    stained.save(tmp_path / "stained.ome.tif")

    files = RecipeFolder(tmp_path / "sheet")
    write_recipe(files.file, Recipe(name="sheet", passes=("rock",), region=REGION))
    teach(files, sets)
    recipe = read_recipe(files.file)
    assert recipe.calibration.required
    inspector = Inspector.load(files, calibration)
    known = CapturedSet.load(sets[0])
    assert inspector.inspect(known).verdict.decision is Decision.PASS

    # Defects are in pixels of the whole image.
    worst = inspector.inspect(stained).defects[0]
    middle = worst.column + worst.width / 2, worst.row + worst.height / 2
    assert middle == pytest.approx((FRAME_PX / 2 + 40, FRAME_PX / 2 + 30), abs=24)

    # Without the calibration, with another one, and with an old one nothing is judged.
    none = Inspector.load(files).inspect(known).verdict
    assert (none.decision, none.causes) == (Decision.ERROR, (Cause.CALIBRATION,))
    old = tmp_path / "old.ps4cal"
    calibrated_with(flat, setting, "2020-01-01T00:00:00Z").write(old)
    other = Inspector.load(files, old)
    assert "does not name the calibration" in other.inspect(known).verdict.reason
    about = known.metadata.model_copy(update={"calibration_ids": (read_calibration(old).hash,)})
    too_old = other.inspect(replace(known, metadata=about)).verdict
    assert too_old.causes == (Cause.CALIBRATION,)
    assert "at most 365" in too_old.reason
    # A clock that was set back makes no calibration young: this one is of 3 days after the part.
    ahead, later = tmp_path / "ahead.ps4cal", datetime.now(UTC) + timedelta(days=3)
    calibrated_with(flat, setting, utc_text(later)).write(ahead)
    about = known.metadata.model_copy(update={"calibration_ids": (read_calibration(ahead).hash,)})
    too_new = Inspector.load(files, ahead).inspect(replace(known, metadata=about)).verdict
    assert too_new.causes == (Cause.CALIBRATION,)
    assert "flat field was measured after the part" in too_new.reason
    # The self-test finds both before the first part.
    (old_check,), (ahead_check,), (known_check,) = (
        [*check_calibration_age(FoundCalibration.of_rig(each), recipe.calibration)]
        for each in (old, ahead, calibration)
    )
    assert old_check.status == ahead_check.status == "fault"
    assert "at most 365" in old_check.seen
    assert "was measured after the part" in ahead_check.seen
    assert known_check.status == "ok"

    # A newer calibration may judge, once the challenge set was met with it.
    newer = tmp_path / "newer.ps4cal"
    calibrated_with(flat, setting, utc_text()).write(newer)
    add_to_challenge(files.challenge, sets[:1], "PASS")
    add_to_challenge(files.challenge, [tmp_path / "stained.ome.tif"], "UNKNOWN")
    replay = require_challenge(files, Inspector.load(files, newer))
    assert replay.fingerprint.calibration_sha256 == read_calibration(newer).hash
