"""Summary of a calibration, and its page: one self-contained HTML file."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle

from capture.base.chart import LETTERS_PT, chart_axes, svg_uri
from capture.base.page import number_text, rendered
from capture.calibration.ps4cal import CalibrationFile, PartRecord
from capture.calibration.setting import PART_NAMES, PartName, Setting
from capture.maps.pictures import ColourScale, fitted_size
from capture.maps.views import SHOWN_LIGHTS, MapView
from classify import Lighting
from classify.base.arrays import Floats
from classify.calibration.calibration import CalibratedLights, Response, Scale
from classify.calibration.dark import Dark
from classify.calibration_benefit import remaining_errors
from classify.lights.flat_field import FlatField

_MAP_PX = 256  # longer side of the maps of a flat field, which are smooth
_NOT_KNOWN = "-"
_Drawing = tuple[str, str, str]
"""Address, title and caption."""
# What each part is for, and the command that measures it.
_USES: dict[PartName, tuple[str, str]] = {
    "dark": ("hot pixels, and the offset of sets without an ambient image", "dark"),
    "response": ("cameras whose pixel values are not linear in light", "response"),
    "noise": ("the noise that the default solver allows for", "response"),
    "flat_field": ("LED levels, fall-off of near lights and vignetting", "plate"),
    "lights": ("true directions and distances of the lights", "plate"),
    "scale": ("lengths in mm, and the distortion of the lens", "scale"),
}
Benefit = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class _PartSummary:
    """One part of a calibration."""

    name: PartName
    record: PartRecord | None  # None if the part was not measured
    age_days: int | None  # None if it was not measured, or its date cannot be read
    use: str
    command: str  # that measures it

    @property
    def title(self) -> str:
        return self.name.replace("_", " ")


def part_summaries(file: CalibrationFile, now: datetime) -> tuple[_PartSummary, ...]:
    """Return all parts in order, also those that were not measured."""
    parts, response = [], file.calibration.response
    for name in PART_NAMES:
        record = file.records.get(name)
        if name == "noise" and record is None and response is not None and not response.linear:
            continue  # it cannot be measured
        use, command = _USES[name]
        if name == "lights" and file.calibration.flat_field is not None:
            command = "lights"  # the plate was measured, but it did not show their positions
        age_days = None if record is None else record.age_days(now)
        parts.append(_PartSummary(name, record, age_days, use, f"ps4rig calibrate {command}"))
    return tuple(parts)


def benefit_of(file: CalibrationFile) -> Benefit:
    """Return the steps of the correction, each with its error of normals in degrees."""
    calibration = file.calibration
    records = [file.records[name] for name in ("flat_field", "lights") if name in file.records]
    if not records:
        return ()
    setting = records[0].setting
    configured = Lighting(np.array(setting.light_directions))
    flat_field = file.records.get("flat_field")
    percent = 0.0 if flat_field is None else flat_field.figures.get("error_percent", 0.0)
    shape = (setting.height_px, setting.width_px)
    return remaining_errors(calibration, configured, shape, percent / 100.0)


def summary_json(
    path: Path, file: CalibrationFile, benefit: Benefit, now: datetime
) -> dict[str, Any]:
    parts, missing = {}, {}
    for part in part_summaries(file, now):
        if part.record is None:
            missing[part.name] = {"use": part.use, "command": part.command}
        else:
            record = part.record.model_dump(mode="json")
            parts[part.name] = {"age_days": part.age_days, **record}
    return {
        "calibration": str(path),
        "calibration_id": file.hash,
        "parts": parts,
        "lights": _lights_json(file),
        "missing": missing,
        "normal_error_deg": dict(benefit),
    }


def _light_rows(file: CalibrationFile) -> list[dict[str, float | None]]:
    """Return tilt, slant and distance of each light with their errors; [] if not measured."""
    lights, scale = file.calibration.lights, file.calibration.scale
    if lights is None:
        return []
    positions = lights.lighting.positions_px
    rows: list[dict[str, float | None]] = []
    for light in range(len(lights.lighting)):
        row: dict[str, float | None] = {
            "tilt_deg": float(lights.lighting.tilts_deg[light]),
            "slant_deg": float(lights.lighting.slants_deg[light]),
            "direction_error_deg": float(lights.direction_errors_deg[light]),
            "distance_px": None,
            "distance_mm": None,
            "distance_error_percent": None,
        }
        if positions is not None:
            distance_px = float(np.linalg.norm(positions[light]))
            row["distance_px"] = distance_px
            row["distance_mm"] = None if scale is None else distance_px * scale.mm_per_px
        if lights.distance_errors is not None:
            row["distance_error_percent"] = 100.0 * float(lights.distance_errors[light])
        rows.append(row)
    return rows


def _lights_json(file: CalibrationFile) -> dict[str, Any] | None:
    lights = file.calibration.lights
    if lights is None:
        return None
    return {
        "source": lights.source,
        "residual": lights.residual,
        "lobe_exponent": lights.lobe_exponent,
        "each": _light_rows(file),
    }


def calibration_page(path: Path, file: CalibrationFile, benefit: Benefit, now: datetime) -> str:
    """Return the page as HTML."""
    calibration = file.calibration
    return rendered(
        "commands/calibrate_page.html",
        title=path.name,
        facts=_facts(file),
        simulated_sheet=any(record.setting.simulated for record in file.records.values()),
        parts=part_summaries(file, now),
        benefit=benefit,
        flat_field=[]
        if calibration.flat_field is None
        else _flat_field_views(calibration.flat_field, file.records["flat_field"].setting),
        lights=calibration.lights,
        light_drawings=list(_light_drawings(file)),
        light_rows=_light_rows(file),
        camera_drawings=list(_camera_drawings(file)),
    )


def _facts(file: CalibrationFile) -> Iterator[tuple[str, str]]:
    settings = [record.setting for record in file.records.values()]
    if settings:
        setting = settings[0]
        yield "rig", setting.rig_name or _NOT_KNOWN
        yield "camera", setting.camera or _NOT_KNOWN
        yield "frame", f"{setting.width_px} x {setting.height_px} px, {setting.bit_depth} bit"
        exposures_ms = {
            setting.exposure_ms for setting in settings if setting.exposure_ms is not None
        }
        if exposures_ms:
            yield "exposure", ", ".join(f"{ms:g}" for ms in sorted(exposures_ms)) + " ms"
    scale = file.calibration.scale
    if scale is not None:
        percent = 100.0 * scale.error
        yield "scale", f"{scale.mm_per_px:.5g} mm/px \N{PLUS-MINUS SIGN} {percent:.2g}%"
        yield "distortion", "below 0.5 px" if scale.distortion is None else "corrected"
    yield "SHA-256", f"{file.hash[:12]}…"


def _flat_field_views(field: FlatField, setting: Setting) -> list[MapView]:
    """Return a map of each light's strength over the frame, on one scale."""
    shape = (setting.height_px, setting.width_px)
    columns, rows = fitted_size(shape, min(_MAP_PX, max(shape)))
    strengths = field.strengths(np.arange(rows), np.arange(columns), (rows, columns))
    percent = (100.0 * (strengths / strengths.mean() - 1.0)).astype(np.float32)
    scale = ColourScale.signed(percent)
    tilts_deg = Lighting(np.array(setting.light_directions)).tilts_deg
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


def _light_drawings(file: CalibrationFile) -> Iterator[_Drawing]:
    lights, scale = file.calibration.lights, file.calibration.scale
    if lights is None:
        return
    frame = _frame(file.records["lights"].setting)
    caption = "Ellipses hold a position with 86%: two standard errors."
    if lights.lighting.positions_px is None:
        caption = "Distant lights: directions, on a dome of radius 1."
    for title, up in (
        ("from above: x to the right, y up", 1),
        ("from the side: x to the right, z up", 2),
    ):
        yield svg_uri(drawn_lights(lights, scale, frame, up)), title, caption


def _camera_drawings(file: CalibrationFile) -> Iterator[_Drawing]:
    calibration = file.calibration
    if calibration.response is not None:
        response = calibration.response
        use = "is so near to linear that it is not applied"
        if not response.linear:
            use = "makes the values of sets linear in light before they are solved"
        caption = f"The curve {use}. Grey: a linear camera."
        yield svg_uri(_response_curve(response)), "response", caption
    if calibration.dark is not None:
        frame = _frame(file.records["dark"].setting)
        for dark in calibration.dark.exposures:
            exposure = "" if dark.exposure_ms is None else f" at {dark.exposure_ms:g} ms"
            caption = (
                f"{len(dark.hot_pixels)} hot pixels. Offset {dark.offset:.4g}, noise "
                f"{dark.noise:.3g} of {dark.full_scale:g}."
            )
            yield svg_uri(hot_pixel_map(dark, frame)), f"dark frames{exposure}", caption


def _frame(setting: Setting) -> Floats:
    return np.array([setting.width_px, setting.height_px], np.float64)


_SIDE_IN = 3.2  # of a square figure, in inches
_MARGIN = 1.25  # drawn range, as a multiple of the largest coordinate
# An ellipse of two standard errors contains the position with a probability of 86 %.
_STANDARD_ERRORS = 2.0
# More dots than this cannot be told apart, and make the page large.
_MAX_DOTS = 2000
_LED, _ERROR, _GREY = "#d6a400", "#b2182b", "#cccccc"


def drawn_lights(lights: CalibratedLights, scale: Scale | None, frame: Floats, up: int) -> Figure:
    """Draw the lights and the frame (width, height in px) with x to the right.

    The coordinate `up` points upwards: 1 for y, seen from above; 2 for z, seen from the side.
    """
    positions = lights.lighting.positions_px
    per_px, unit = (1.0, "px") if scale is None else (scale.mm_per_px, "mm")
    places = lights.lighting.directions if positions is None else per_px * positions
    figure, axes = chart_axes(_SIDE_IN, _SIDE_IN)
    axes.set_aspect("equal")
    reach = float(np.abs(places[:, [0, up]]).max())
    if positions is not None:
        axes.set_xlabel(unit)
        width, depth = per_px * frame
        height = depth if up == 1 else 0.0
        axes.add_patch(Rectangle((-0.5 * width, -0.5 * height), width, height, fill=False))
        reach = max(reach, 0.5 * per_px * float(frame.max()))
    names: defaultdict[tuple[float, float], list[str]] = defaultdict(list)
    for index, place in enumerate(places):
        point = place[[0, up]]
        axes.plot([0.0, point[0]], [0.0, point[1]], color=_GREY, linewidth=0.8, zorder=0)
        covariance = _covariance(lights, index, place)[np.ix_([0, up], [0, up])]
        axes.add_patch(_ellipse(point, covariance))
        x, y = (point / reach).round(1) + 0.0
        names[float(x), float(y)].append(str(index))
    axes.scatter(places[:, 0], places[:, up], s=8, color=_LED)
    for (x, y), indices in names.items():  # lights at one point of the drawing share a label
        axes.annotate(
            ", ".join(indices), (reach * x, reach * y), (3, 3), fontsize=LETTERS_PT,
            textcoords="offset points",
        )  # fmt: skip
    axes.set_xlim(-_MARGIN * reach, _MARGIN * reach)
    axes.set_ylim(-_MARGIN * reach if up == 1 else -0.1 * reach, _MARGIN * reach)
    return figure


def _covariance(lights: CalibratedLights, index: int, place: Floats) -> Floats:
    """(3, 3) covariance of a position from the errors of its direction and its distance."""
    distance = float(np.linalg.norm(place))
    along = np.outer(place, place) / distance**2
    across = np.eye(3) - along
    angle = np.radians(lights.direction_errors_deg[index])
    share = 0.0 if lights.distance_errors is None else lights.distance_errors[index]
    covariance: Floats = distance**2 * (share**2 * along + angle**2 * across)
    return covariance


def _ellipse(point: Floats, covariance: Floats) -> Ellipse:
    variances, axes = np.linalg.eigh(covariance)
    height, width = 2.0 * _STANDARD_ERRORS * np.sqrt(np.maximum(variances, 0.0))
    angle_deg = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
    return Ellipse((point[0], point[1]), width, height, angle=angle_deg, color=_ERROR, alpha=0.5)


def _response_curve(response: Response) -> Figure:
    """Draw linear light over the pixel value, both from 0 to full scale, and a linear camera."""
    figure, axes = chart_axes(_SIDE_IN, _SIDE_IN)
    axes.set_aspect("equal")
    axes.plot([0.0, 1.0], [0.0, 1.0], color=_GREY)
    axes.plot(np.linspace(0.0, 1.0, len(response.curve)), response.curve)
    axes.set_xlabel("pixel value / full scale")
    axes.set_ylabel("light")
    return figure


def hot_pixel_map(dark: Dark, frame: Floats) -> Figure:
    """Draw the places of hot pixels in the frame (width, height in px)."""
    figure, axes = chart_axes(_SIDE_IN, _SIDE_IN)
    axes.set_aspect("equal")
    rows, columns = dark.hot_pixels[:_MAX_DOTS].T
    axes.scatter(columns, rows, s=6, color=_ERROR)
    axes.set_xlim(-0.5, frame[0] - 0.5)
    axes.set_ylim(frame[1] - 0.5, -0.5)
    return figure
