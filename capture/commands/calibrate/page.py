"""The page of a calibration: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from capture.base.page import number_text, rendered
from capture.calibration.ps4cal import CalibrationFile
from capture.calibration.setting import Setting
from capture.maps.pictures import ColourScale
from capture.maps.views import SHOWN_LIGHTS, MapView
from classify.lights.flat_field import FlatField

from . import drawings
from .summary import Benefit, light_rows, part_summaries

_MAP_PX = 256  # longer side of the maps of a flat field, which is smooth
_NOT_KNOWN = "-"
Drawing = tuple[Markup, str, str]  # with its title and caption


def calibration_page(path: Path, file: CalibrationFile, benefit: Benefit, now: datetime) -> str:
    """Return the page as HTML."""
    calibration = file.calibration
    return rendered(
        "commands/calibrate/page.html",
        title=path.name,
        facts=_facts(file),
        simulated_sheet=any(record.setting.simulated for record in file.records.values()),
        parts=part_summaries(file, now),
        benefit=benefit,
        flat_field=[]
        if calibration.flat_field is None
        else flat_field_views(calibration.flat_field, file.records["flat_field"].setting),
        lights=calibration.lights,
        light_drawings=list(_light_drawings(file)),
        light_rows=light_rows(file),
        camera_drawings=list(_camera_drawings(file)),
    )


def _facts(file: CalibrationFile) -> Iterator[tuple[str, str]]:
    settings = [record.setting for record in file.records.values()]
    if settings:
        setting = settings[0]
        yield "rig", setting.rig_name or _NOT_KNOWN
        yield "camera", setting.camera or _NOT_KNOWN
        yield "frame", f"{setting.width_px} x {setting.height_px} px, {setting.bit_depth} bit"
        exposures_ms = {one.exposure_ms for one in settings if one.exposure_ms is not None}
        if exposures_ms:
            yield "exposure", ", ".join(f"{ms:g}" for ms in sorted(exposures_ms)) + " ms"
    scale = file.calibration.scale
    if scale is not None:
        share = 100.0 * scale.error
        yield "scale", f"{scale.mm_per_px:.5g} mm/px \N{PLUS-MINUS SIGN} {share:.2g}%"
        yield "distortion", "below 0.5 px" if scale.distortion is None else "corrected"
    yield "SHA-256", f"{file.hash[:12]}…"


def flat_field_views(field: FlatField, setting: Setting) -> list[MapView]:
    """Return a map of each light's strength over the frame, on one scale."""
    rows, columns = _small_frame(setting)
    strengths = field.strengths(np.arange(rows), np.arange(columns), (rows, columns))
    percent = (100.0 * (strengths / strengths.mean() - 1.0)).astype(np.float32)
    scale = ColourScale.signed(percent)
    tilts_deg = _tilts_deg(setting)
    return [
        MapView(
            None,
            f"light {light}: tilt {tilts_deg[light]:.0f}",
            f"From {number_text(float(strength.min()))}% to {number_text(float(strength.max()))}%, "
            f"{number_text(float(strength.mean()))}% on average.",
            scale.paint(strength),
            scale,
            "% against the mean of all lights",
        )
        for light, strength in enumerate(percent[:SHOWN_LIGHTS])
    ]


def _small_frame(setting: Setting) -> tuple[int, int]:
    scale = min(1.0, _MAP_PX / max(setting.width_px, setting.height_px))
    return max(1, round(scale * setting.height_px)), max(1, round(scale * setting.width_px))


def _tilts_deg(setting: Setting) -> npt.NDArray[np.float64]:
    directions = np.array(setting.light_directions)
    return np.asarray(np.degrees(np.arctan2(directions[:, 1], directions[:, 0])) % 360.0)


def _light_drawings(file: CalibrationFile) -> Iterator[Drawing]:
    lights, scale = file.calibration.lights, file.calibration.scale
    if lights is None:
        return
    frame = _frame(file.records["lights"].setting)
    caption = "Ellipses hold a position with 86%: two standard errors."
    if lights.lighting.positions_px is None:
        caption = "Distant lights: directions, on a dome of radius 1."
    above, side = drawings.lights_from_above, drawings.lights_from_the_side
    yield above(lights, scale, frame), "from above: x to the right, y up", caption
    yield side(lights, scale, frame), "from the side: x to the right, z up", caption


def _camera_drawings(file: CalibrationFile) -> Iterator[Drawing]:
    calibration = file.calibration
    if calibration.response is not None:
        response = calibration.response
        use = "Taken as linear; the curve is not applied." if response.linear else "Undone."
        yield drawings.response_curve(response), "response", f"{use} Grey: linear."
    if calibration.dark is not None:
        frame = _frame(file.records["dark"].setting)
        for dark in calibration.dark.exposures:
            exposure = "" if dark.exposure_ms is None else f" at {dark.exposure_ms:g} ms"
            caption = (
                f"{len(dark.hot_pixels)} hot pixels. Offset {dark.offset:.4g}, noise "
                f"{dark.noise:.3g} of {dark.full_scale:g}."
            )
            yield (
                drawings.hot_pixel_map(dark, frame),
                f"dark frames{exposure}",
                caption,
            )


def _frame(setting: Setting) -> npt.NDArray[np.float64]:
    return np.array([setting.width_px, setting.height_px], np.float64)
