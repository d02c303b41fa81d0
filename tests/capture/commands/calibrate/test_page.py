"""The page and the summary of a calibration: complete, self-contained, escaped."""

import json
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Ellipse

from capture.calibration.ps4cal import CalibrationFile
from capture.commands.calibrate_page import (
    benefit_of,
    calibration_page,
    drawn_lights,
    hot_pixel_map,
    part_summaries,
)
from classify import Lighting
from classify.calibration.calibration import Response, Scale
from classify.calibration.dark import Dark
from tests.html_page import Page

FRAME_PX = np.array([128.0, 128.0])
NOW = datetime(2026, 11, 22, tzinfo=UTC)
EVIL = "<script>alert(\"$title & 'x'\")</script>"


@pytest.fixture(scope="module")
def whole(near_calibration: CalibrationFile) -> CalibrationFile:
    """The calibration of a simulated rig, with all parts that it can have."""
    record = near_calibration.records["flat_field"].model_copy(
        update={"quality": f"good {EVIL}", "date": (NOW - timedelta(days=40)).isoformat()}
    )
    lights = near_calibration.calibration.lights
    assert lights is not None
    errors = replace(lights, direction_errors_deg=np.full(4, 0.4), distance_errors=np.full(4, 0.02))
    file = near_calibration.with_part("lights", errors, record)
    hot = np.array([[3, 4], [100, 20]], np.int32)
    file = file.with_part("dark", Dark(64.0, 2.0, hot, None, 4095.0), record)
    curve = Response(np.linspace(0.0, 1.0, 257) ** 2.2, 0.002, linear=False)
    file = file.with_part("response", curve, record)
    return file.with_part("scale", Scale(0.02, 0.001, np.eye(3), None, 0.1), record)


def page_of(file: CalibrationFile) -> Page:
    page = Page(calibration_page(Path(f"{EVIL}.ps4cal"), file, benefit_of(file), NOW))
    assert page.open == []
    return page


def test_the_page_shows_maps_positions_curve_and_hot_pixels(whole: CalibrationFile) -> None:
    page = page_of(whole)
    assert [image["alt"] for image in page.all("img")] == [
        *(f"light {light}: tilt {90 * light}" for light in range(4)),
        "from above: x to the right, y up", "from the side: x to the right, z up",
        "response", "dark frames",
    ]  # fmt: skip


def test_hot_pixels_are_drawn_at_their_places(whole: CalibrationFile) -> None:
    assert whole.calibration.dark is not None
    (axes,) = hot_pixel_map(whole.calibration.dark, FRAME_PX).axes
    np.testing.assert_array_equal(axes.collections[0].get_offsets(), [(4, 3), (20, 100)])


def test_the_page_states_age_scale_and_benefit(whole: CalibrationFile) -> None:
    text = page_of(whole).text
    for words in (
        "40 days", "0.02 mm/px",
        "6.4 mm \N{PLUS-MINUS SIGN} 2%", "without calibration", "flat field, lights", "Simulated",
    ):  # fmt: skip
        assert words in text


def test_the_page_refers_to_no_other_file_and_escapes_text(whole: CalibrationFile) -> None:
    page = page_of(whole)
    assert not [*page.all("script"), *page.all("link"), *page.all("a")]
    assert page.text.count(EVIL) >= 3
    policies = [meta["content"] for meta in page.all("meta") if "http-equiv" in meta]
    assert policies == ["default-src 'none'; img-src data:; style-src 'unsafe-inline'"]


def test_drawn_positions_are_the_measured_ones(whole: CalibrationFile) -> None:
    """Light 0 is on the right and light 1 above, by the same distance."""
    lights, scale = whole.calibration.lights, whole.calibration.scale
    assert lights is not None
    (axes,) = drawn_lights(lights, scale, FRAME_PX, up=1).axes
    reach_mm = 320.0 * 0.02 * np.sqrt(0.5)
    expected = reach_mm * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    np.testing.assert_allclose(axes.collections[0].get_offsets(), expected, rtol=0.01, atol=0.02)
    assert axes.get_xlabel() == "mm"
    ellipses = [patch for patch in axes.patches if isinstance(patch, Ellipse)]
    # Two standard errors on either side: 2 % of the distance, and 0.4 degrees across.
    assert ellipses[0].width == pytest.approx(4.0 * 0.02 * reach_mm, rel=0.2)
    assert ellipses[1].get_height() == pytest.approx(4.0 * np.radians(0.4) * 6.4, rel=0.1)


def test_a_calibration_without_sheet_or_with_a_strange_date_is_summarised(
    near_calibration: CalibrationFile,
) -> None:
    record = near_calibration.records["lights"].model_copy(update={"date": "yesterday"})
    dark = Dark(64.0, 2.0, np.zeros((0, 2), np.int32), None, 4095.0)
    file = CalibrationFile().with_part("dark", dark, record)
    assert benefit_of(file) == ()
    first, *others = part_summaries(file, NOW)
    assert (first.title, first.age_days) == ("dark", None)
    assert all(part.record is None and part.command for part in others)
    text = page_of(file).text
    assert "What it buys" not in text
    assert "lengths in mm" in text
    assert page_of(CalibrationFile()).text


def test_distant_lights_are_drawn_as_directions(near_calibration: CalibrationFile) -> None:
    measured = near_calibration.calibration.lights
    assert measured is not None
    distant = replace(
        measured, lighting=Lighting.ring(45.0), distance_errors=None, lobe_exponent=None
    )
    file = near_calibration.with_part("lights", distant, near_calibration.records["lights"])
    text = page_of(file).text
    assert "Distant lights: directions" in text
    assert " px \N{PLUS-MINUS SIGN}" not in text


@pytest.fixture
def saved(whole: CalibrationFile, tmp_path: Path) -> Path:
    path = tmp_path / "rig.ps4cal"
    whole.write(path)
    return path


def test_show_prints_a_summary_and_writes_the_page(ps4rig: Callable[..., Any], saved: Path) -> None:
    done = ps4rig("calibrate", "show", saved)
    assert done.exit_code == 0
    for words in ("flat field", "without calibration:", "rig.html: maps"):
        assert words in done.stdout
    assert "missing" not in done.stdout
    assert "image/svg" in saved.with_suffix(".html").read_text(encoding="utf-8")
    other = saved.with_name("other.html")
    assert ps4rig("calibrate", "show", saved, "--out", other).exit_code == 0
    assert other.exists()


def test_show_prints_json_without_a_page(
    ps4rig: Callable[..., Any], saved: Path, whole: CalibrationFile
) -> None:
    done = ps4rig("calibrate", "show", saved, "--json")
    assert done.exit_code == 0
    said = json.loads(done.stdout)
    assert said["calibration_id"] == whole.hash
    assert set(said["parts"]) == {"dark", "response", "flat_field", "lights", "scale"}
    assert said["missing"] == {}
    assert said["lights"]["each"][0]["distance_mm"] == pytest.approx(320.0 * 0.02)
    assert said["normal_error_deg"]["without calibration"] > 8.0
    assert not saved.with_suffix(".html").exists()


def test_show_names_missing_parts_with_their_command(
    ps4rig: Callable[..., Any], near_calibration: CalibrationFile, tmp_path: Path
) -> None:
    path = tmp_path / "plate.ps4cal"
    near_calibration.write(path)
    said = json.loads(ps4rig("calibrate", "show", path, "--json").stdout)
    assert set(said["missing"]) == {"dark", "response", "noise", "scale"}
    assert said["missing"]["scale"]["command"] == "ps4rig calibrate scale"
    assert "missing: dark" in ps4rig("calibrate", "show", path).stdout
