"""`python -m tests.evidence.calibration`: errors of calibrated rigs beside the ideal one."""

import csv
from pathlib import Path

import numpy as np
import pytest

from classify import Lighting
from classify.calibration.calibration import CalibratedLights
from tests.evidence.calibration.lights import light_errors
from tests.evidence.calibration.rigs import Conditions
from tests.evidence.calibration.run import reproduce_calibration

NEAR = Conditions(5.0, 12, 1.0, 100)
# Most degrees beyond the ideal rig, by the distance of the LEDs in fields of view.
MORE_THAN_IDEAL_DEG = {"5": 0.3, "2": 0.6}


def test_the_errors_of_lights_are_the_largest_of_all() -> None:
    true = Lighting.ring(45.0).directions
    positions_px = 500.0 * true * np.array([1.0, 1.02, 0.97, 1.0])[:, None]
    turned = Lighting.from_angles([0.0, 90.0, 181.0, 270.0], 45.0).directions
    positions_px[2] = 485.0 * turned[2]
    lights = CalibratedLights(
        Lighting.near(positions_px), "plate", np.array([0.1, 0.2, 0.3, 0.1]), np.full(4, 0.01),
        0.001, 1.0,
    )  # fmt: skip
    found = light_errors(NEAR, lights)
    assert found.distance_pct == pytest.approx(3.0)
    assert found.direction_deg == pytest.approx(np.sqrt(0.5), rel=1e-3)  # sin of the slant
    assert (found.stated_direction_deg, found.stated_distance_pct) == (0.3, 1.0)


def table(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / f"{name}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_calibrated_rigs_are_within_a_fraction_of_a_degree_of_the_ideal_one(
    tmp_path: Path,
) -> None:
    page = reproduce_calibration(tmp_path / "out")
    assert "Calibration of a rig" in page.read_text(encoding="utf-8")
    errors = table(page.parent, "calibration")
    assert len(errors) == 8
    for row in errors:
        assert float(row["raw"]) > 5.0
        assert float(row["more than ideal"]) < MORE_THAN_IDEAL_DEG[row["LEDs at, fields"]]
    for row in table(page.parent, "calibration_lights"):
        limit_deg = {"plate": 1.5, "mirror sphere": 0.5, "matte sphere": 2.0}[row["target"]]
        assert float(row["direction, degrees"]) < limit_deg
        if row["target"] == "plate":
            assert float(row["distance, %"]) < 3.0
