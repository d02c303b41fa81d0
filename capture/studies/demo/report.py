"""The report of the demo: one self-contained HTML file."""

import math
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from pathlib import Path
from string import Template

from capture.maps import pictures
from capture.maps.figures import TILE_PX, tile_html
from capture.page.skeleton import document_html, table_html
from capture.sets.captured_set import CapturedSet
from classify import Evaluation, Spectra, SurfaceEstimate, Trial
from classify.durable_file import durable_file
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
    body, style = (
        Path(__file__).with_name(name).read_text(encoding="utf-8")
        for name in ("report.html", "report.css")
    )
    body = Template(body).substitute(
        version=version("ps4rig"),
        controller=escape(
            f"{controller.vendor} {controller.model} {controller.serial_number}, firmware "
            f"{controller.firmware_version}"
        ),
        camera=f"{config.camera.width_px} x {config.camera.height_px} px, "
        f"{config.camera.bits} bit, {config.camera.frame_rate_hz:g} Hz, "
        f"{config.camera.exposure_ms:g} ms",
        slant_deg=f"{config.lights.slant_deg:g}",
        correct=str(result.correct),
        sets=str(result.sets),
        classes=str(len(result.per_class)),
        angle_note=ANGLE_NOTE,
        table=table_html(COLUMNS, (_row(i, entry.trial) for i, entry in enumerate(entries))),
        details="\n".join(_detail(number, entry) for number, entry in enumerate(entries)),
    )
    with durable_file(path) as temporary:
        temporary.write_text(
            document_html("ps4rig demo: simulated rig", body, style), encoding="utf-8"
        )


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


def _row(number: int, trial: Trial) -> str:
    label, *cells = map(escape, cells_of(trial))
    kind = "right" if trial.is_correct else "wrong"
    linked = "".join(
        f"<td>{cell}</td>" for cell in (f'<a href="#set-{number}">{label}</a>', *cells)
    )
    return f'<tr class="{kind}">{linked}</tr>'


def _detail(number: int, entry: ReportEntry) -> str:
    trial, match, surface = entry.trial, entry.trial.match, entry.surface
    maps = {
        **pictures.light_images(entry.captured, 4),
        "lights in shadow": pictures.shadow_map(surface),
        "albedo": pictures.grey(surface.albedo),
        "relief": pictures.shaded(surface.normals),
        "normals": pictures.normal_map(surface.normals),
    }
    figures = [tile_html(name, picture) for name, picture in maps.items()]
    for name, test, reference in zip(
        ("gradient", "albedo"), entry.spectra.polar, entry.reference.polar, strict=True
    ):
        figures.append(
            f"<figure>{_polar_plot(test, reference, match.orientation_deg or 0.0)}"
            f"<figcaption>polar spectrum of {name}</figcaption></figure>"
        )
    verdict = (
        f"Found <b>{escape(match.label or 'unknown')}</b> at {match.orientation_deg:.1f}°. "
        f"{surface.shadow_mask.mean():.1%} of the pixels are in shadow of a light."
    )
    return (
        f'<section id="set-{number}"><h2>{escape(trial.label)}, '
        f"{trial.orientation_deg:.0f}°</h2><p>{verdict}</p>"
        f'<div class="figures">{"".join(figures)}</div></section>'
    )


def _polar_plot(test: FloatMap, reference: FloatMap, orientation_deg: float) -> str:
    """SVG: the test as a line, the nearest training set at the orientation found as an area."""
    top = max(float(test.max()), float(reference.max()), 1e-12)
    return (
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
