"""The report of the demo: one self-contained HTML file."""

import math
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from capture.base.page import rendered
from capture.maps import pictures
from capture.maps.pictures import TILE_PX, tile_uri
from capture.sets.captured_set import CapturedSet
from classify import (
    Evaluation,
    Spectra,
    SurfaceEstimate,
    Trial,
)
from classify.base.durable_file import durable_file
from classify.surface.estimate import FloatMap
from rig import ControllerIdentity, RigConfig

COLUMNS = ("true", "found", "true, °", "found, °", "distance", "runner-up", "margin")

ANGLE_NOTE = (
    "Angles are modulo 180 degrees. A texture without direction (rock, malv) has none, and one "
    "that looks the same after 90 degrees (Tiles036) is known modulo 90 only."
)


@dataclass(frozen=True, eq=False)
class ReportEntry:
    """One classified set; `reference` are the spectra of the nearest training set."""

    captured: CapturedSet
    surface: SurfaceEstimate
    trial: Trial
    spectra: Spectra
    reference: Spectra


def write_report(
    path: Path,
    entries: list[ReportEntry],
    result: Evaluation,
    controller: ControllerIdentity,
    config: RigConfig,
) -> None:
    """Write the report as a whole or not at all."""
    page = rendered(
        "chapter/demo_report.html",
        title="ps4rig demo",
        controller=controller,
        config=config,
        result=result,
        angle_note=ANGLE_NOTE,
        columns=COLUMNS,
        rows=[(entry.trial.is_correct, cells_of(entry.trial)) for entry in entries],
        entries=[(entry, _tiles(entry), _polar_plots(entry)) for entry in entries],
    )
    with durable_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def cells_of(trial: Trial) -> tuple[str, ...]:
    """Texts of a row of the table: one for each of `COLUMNS`."""
    match = trial.match
    return (
        trial.label,
        match.label or "unknown",
        f"{trial.orientation_deg or 0.0:.1f}",
        f"{match.orientation_deg:.1f}",
        f"{match.distance:.4f}",
        match.runner_up or "-",
        "-" if match.margin is None else f"{match.margin:.2f}",
    )


def _tiles(entry: ReportEntry) -> dict[str, str]:
    maps = {
        **pictures.light_images(entry.captured, 4),
        "lights in shadow": pictures.coloured(
            entry.surface.shadow_count, pictures.shadow_colours()
        ),
        "albedo": pictures.grey(entry.surface.albedo),
        "relief": pictures.shaded(entry.surface.normals),
        "normals": pictures.normal_map(entry.surface.normals),
    }
    return {name: tile_uri(picture) for name, picture in maps.items()}


def _polar_plots(entry: ReportEntry) -> dict[str, Markup]:
    orientation_deg = entry.trial.match.orientation_deg or 0.0
    return {
        name: _polar_plot(test, reference, orientation_deg)
        for name, test, reference in zip(
            ("gradient", "albedo"), entry.spectra.polar, entry.reference.polar, strict=True
        )
    }


def _polar_plot(test: FloatMap, reference: FloatMap, orientation_deg: float) -> Markup:
    """SVG: the test as a line, the nearest training set at the orientation found as an area."""
    top = max(float(test.max()), float(reference.max()), 1e-12)
    return Markup(
        f'<svg viewBox="-1.1 -1.1 2.2 2.2" width="{TILE_PX}" height="{TILE_PX}">'
        '<circle r="1" class="frame"/><circle r="0.5" class="frame"/>'
        f'<polygon class="reference" points="{_points(reference / top, orientation_deg)}"/>'
        f'<polygon class="test" points="{_points(test / top, 0.0)}"/></svg>'
    )


def _points(radii: FloatMap, orientation_deg: float) -> str:
    # The spectrum covers 180 degrees; the other half is equal by point symmetry.
    count = len(radii)
    points = []
    for index in range(2 * count):
        angle = math.pi * index / count + math.radians(orientation_deg)
        radius = float(radii[index % count])
        points.append(f"{radius * math.cos(angle):.3f},{-radius * math.sin(angle):.3f}")
    return " ".join(points)
