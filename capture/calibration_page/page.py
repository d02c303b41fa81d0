"""The page of a calibration: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from html import escape
from pathlib import Path

import numpy as np
import numpy.typing as npt

from capture.calibration.ps4cal import CalibrationFile
from capture.calibration.setting import Setting
from capture.maps.figures import figure_html, number_text
from capture.maps.pictures import ColourScale
from capture.maps.views import SHOWN_LIGHTS, MapView
from capture.page.skeleton import page_html, simulated_notice, table_html
from classify.lights.flat_field import FlatField

from . import drawings
from .summary import Benefit, PartSummary, light_rows, part_summaries

_STYLE = Path(__file__).with_name("page.css")
_MAP_PX = 256  # longer side of the maps of a flat field, which is smooth
_NOT_KNOWN = "-"


def calibration_page(path: Path, file: CalibrationFile, benefit: Benefit, now: datetime) -> str:
    """Return the page as HTML; all text from the file is escaped."""
    settings = [record.setting for record in file.records.values()]
    sections = {
        "Parts": _parts(part_summaries(file, now)),
        "What it buys": _benefit(benefit),
        "Light on a white sheet": _flat_field(file),
        "Positions of the lights": _lights(file),
        "Camera": _camera(file),
    }
    return page_html(
        path.name,
        "calibration",
        sections,
        facts=_facts(file),
        notices=[simulated_notice("sheet") * any(setting.simulated for setting in settings)],
        note="x to the right, y up, z to the camera, from the middle of the frame.",
        style=_STYLE.read_text(encoding="utf-8"),
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


def _parts(parts: tuple[PartSummary, ...]) -> str:
    return table_html(("part", "measured", "age", "quality", "source"), map(_part, parts))


def _part(part: PartSummary) -> str:
    if part.record is None:
        wanted = f"not measured: {escape(part.use)}. <code>{escape(part.command)}</code>"
        return (
            f'<tr class="missing"><td>{escape(part.title)}</td><td colspan="4">{wanted}</td></tr>'
        )
    record = part.record
    figures = "; ".join(
        f"{name.replace('_', ' ')} {value:.4g}" for name, value in record.figures.items()
    )
    date = record.date[:16].replace("T", " ")
    age = _NOT_KNOWN if part.age_days is None else f"{part.age_days} days"
    return (
        f"<tr><td><b>{escape(part.title)}</b></td><td>{escape(date)}</td>"
        f'<td class="value">{age}</td><td>{escape(record.quality)}<br>'
        f'<small class="figures">{escape(figures)}</small></td>'
        f"<td>{escape(', '.join(record.source))}</td></tr>"
    )


def _benefit(benefit: Benefit) -> str:
    if not benefit:
        return ""
    longest = max(degrees for _, degrees in benefit) or 1.0
    rows = (
        f'<tr><td>{escape(name)}</td><td class="value">{degrees:.2f}°</td>'
        f'<td class="length"><div style="width:{100.0 * degrees / longest:.1f}%"></div></td></tr>'
        for name, degrees in benefit
    )
    return (
        "<p>Mean error of normals on a matt part of rms slope 0.3, simulated with the faults and "
        "the uncertainties that this calibration has measured, without noise and shadow. "
        "One fault may hide another, so that the error can rise before the last step.</p>"
        + table_html(("corrected", "error", ""), rows)
    )


def _flat_field(file: CalibrationFile) -> str:
    field = file.calibration.flat_field
    if field is None:
        return ""
    setting = file.records["flat_field"].setting
    return f'<div class="maps">{"".join(map(figure_html, flat_field_views(field, setting)))}</div>'


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


def _lights(file: CalibrationFile) -> str:
    lights = file.calibration.lights
    if lights is None:
        return ""
    frame, scale = _frame(file.records["lights"].setting), file.calibration.scale
    is_near = lights.lighting.positions_px is not None
    seen = (
        "Ellipses hold a position with 86%: two standard errors."
        if is_near
        else "Distant lights: directions, on a dome of radius 1."
    )
    figures = "".join(
        f"<figure>{drawing(lights, scale, frame)}<figcaption><b>{title}</b><br>{seen}</figcaption>"
        "</figure>"
        for title, drawing in (
            ("from above: x to the right, y up", drawings.lights_from_above),
            ("from the side: x to the right, z up", drawings.lights_from_the_side),
        )
    )
    lobe = "" if lights.lobe_exponent is None else f"; lobe cos^{lights.lobe_exponent:.2f}"
    about = (
        f"<p>From a {escape(lights.source)}; rms residual {lights.residual:.2%} of the signal"
        f"{lobe}.</p>"
    )
    return f'{about}<div class="maps">{figures}<div class="wide">{_light_table(file)}</div></div>'


def _light_table(file: CalibrationFile) -> str:
    def rows() -> Iterator[str]:
        for light, row in enumerate(light_rows(file)):
            distance = _measured(row["distance_mm"], "mm") or _measured(row["distance_px"], "px")
            error = row["distance_error_percent"]
            tilt_deg = round(row["tilt_deg"] or 0.0, 1) % 360.0
            if distance and error is not None:
                distance += f" \N{PLUS-MINUS SIGN} {error:.2g}%"
            yield (
                f"<tr><td>{light}</td>"
                f'<td class="value">{tilt_deg:.1f}°</td>'
                f'<td class="value">{row["slant_deg"]:.1f}°</td>'
                f'<td class="value">\N{PLUS-MINUS SIGN} {row["direction_error_deg"]:.2g}°</td>'
                f'<td class="value">{distance or "distant"}</td></tr>'
            )

    return table_html(("light", "tilt", "slant", "direction", "distance"), rows())


def _measured(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:.4g} {unit}"


def _camera(file: CalibrationFile) -> str:
    calibration, figures = file.calibration, []
    if calibration.response is not None:
        response = calibration.response
        said = "Taken as linear; the curve is not applied." if response.linear else "Undone."
        figures.append((drawings.response_curve(response), "response", f"{said} Grey: linear."))
    if calibration.dark is not None:
        frame = _frame(file.records["dark"].setting)
        for dark in calibration.dark.exposures:
            said = (
                f"{len(dark.hot_pixels)} hot pixels. Offset {dark.offset:.4g}, noise "
                f"{dark.noise:.3g} of {dark.full_scale:g}."
            )
            at = "" if dark.exposure_ms is None else f" at {dark.exposure_ms:g} ms"
            figures.append((drawings.hot_pixel_map(dark, frame), f"dark frames{at}", said))
    shown = "".join(
        f"<figure>{drawing}<figcaption><b>{title}</b><br>{escape(said)}</figcaption></figure>"
        for drawing, title, said in figures
    )
    return f'<div class="maps">{shown}</div>' if shown else ""


def _frame(setting: Setting) -> npt.NDArray[np.float64]:
    return np.array([setting.width_px, setting.height_px], np.float64)
