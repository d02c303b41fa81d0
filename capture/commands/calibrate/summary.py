"""Summary of a calibration: its parts with their age, missing parts, its benefit."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from capture.calibration.parts import PART_NAMES, PartName
from capture.calibration.ps4cal import CalibrationFile, PartRecord
from classify import Lighting
from classify.calibration_benefit import errors_left

# What a part is for, and the command that measures it.
_USES: dict[PartName, tuple[str, str]] = {
    "dark": ("hot pixels, and the offset of sets without an ambient image", "dark"),
    "response": ("cameras whose pixel values are not linear in light", "response"),
    "noise": ("the noise that the default solver allows for", "response"),
    "flat_field": ("LED levels, fall-off of near lights and vignetting", "plate"),
    "lights": ("true directions and distances of the lights", "plate"),
    "scale": ("lengths in mm, and the distortion of the lens", "scale"),
}
Benefit = tuple[tuple[str, float], ...]
FLAT_FIELD_ERROR = "error_percent"  # in the figures of a flat field


@dataclass(frozen=True)
class PartSummary:
    """One part of a calibration."""

    name: PartName
    record: PartRecord | None  # None if the part was not measured
    age_days: int | None  # None too for a date that cannot be read
    use: str
    command: str  # that measures it

    @property
    def title(self) -> str:
        return self.name.replace("_", " ")


def part_summaries(file: CalibrationFile, now: datetime) -> tuple[PartSummary, ...]:
    """Return all parts in order, also those that were not measured."""
    parts, response = [], file.calibration.response
    for name in PART_NAMES:
        record = file.records.get(name)
        if name == "noise" and record is None and response is not None and not response.linear:
            continue  # it cannot be measured
        use, command = _USES[name]
        if name == "lights" and file.calibration.flat_field is not None:
            command = "lights"  # their positions do not show on the sheet
        age_days = None if record is None else record.age_days(now)
        parts.append(PartSummary(name, record, age_days, use, f"ps4rig calibrate {command}"))
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
    percent = 0.0 if flat_field is None else flat_field.figures.get(FLAT_FIELD_ERROR, 0.0)
    shape = (setting.height_px, setting.width_px)
    return errors_left(calibration, configured, shape, percent / 100.0)


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


def light_rows(file: CalibrationFile) -> list[dict[str, float | None]]:
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
    fit = {"source": lights.source, "residual": lights.residual}
    return {**fit, "lobe_exponent": lights.lobe_exponent, "each": light_rows(file)}
