"""The demo's report: one HTML file that needs nothing beside it."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from pathlib import Path
from string import Template

import cv2

from capture.maps import pictures
from capture.sets.captured_set import CapturedSet
from classify import Evaluation, Match, Spectra, SurfaceEstimate
from classify.durable_file import durable_file
from classify.surface.estimate import FloatMap
from rig import ControllerIdentity, RigConfig

__all__ = ["ANGLE_NOTE", "ReportEntry", "write_report"]

ANGLE_NOTE = (
    "Angles are modulo 180 degrees. A texture without direction (rock, malv) has none, and one "
    "that looks the same after a quarter turn (Tiles036) is known modulo 90 only."
)
_PICTURE_PX = 176
_TEMPLATE = Path(__file__).with_name("report.html")


@dataclass(frozen=True, eq=False)
class ReportEntry:
    """One classified set with all that led to its verdict."""

    label: str
    orientation_deg: float
    captured: CapturedSet
    surface: SurfaceEstimate
    match: Match
    spectra: Spectra
    reference: Spectra


def write_report(
    path: Path,
    entries: list[ReportEntry],
    result: Evaluation,
    controller: ControllerIdentity,
    config: RigConfig,
) -> None:
    """Write the report to `path`, whole or not at all."""
    page = Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(
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
        rows="\n".join(_row(number, entry) for number, entry in enumerate(entries)),
        details="\n".join(_detail(number, entry) for number, entry in enumerate(entries)),
    )
    with durable_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _row(number: int, entry: ReportEntry) -> str:
    match = entry.match
    cells = (
        f'<a href="#set-{number}">{escape(entry.label)}</a>',
        escape(match.label or "unknown"),
        f"{entry.orientation_deg:.1f}°",
        f"{match.orientation_deg:.1f}°",
        f"{match.distance:.4f}",
        escape(match.runner_up or "-"),
        "-" if match.margin is None else f"{match.margin:.2f}",
    )
    kind = "right" if match.label == entry.label else "wrong"
    return f'<tr class="{kind}">' + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _detail(number: int, entry: ReportEntry) -> str:
    match, surface = entry.match, entry.surface
    shown = {
        **pictures.light_pictures(entry.captured),
        "lights in shadow": pictures.shadow_map(surface),
        "albedo": pictures.grey(surface.albedo),
        "relief": pictures.relief(surface),
        "normals": pictures.normal_map(surface.normals),
    }
    figures = [
        f'<figure><img alt="{escape(name)}" src="{_jpeg(picture)}">'
        f"<figcaption>{escape(name)}</figcaption></figure>"
        for name, picture in shown.items()
    ]
    turn_deg = match.orientation_deg or 0.0
    for name, test, reference in zip(
        ("gradient", "albedo"), entry.spectra.polar, entry.reference.polar, strict=True
    ):
        figures.append(
            f"<figure>{_polar_plot(test, reference, turn_deg)}"
            f"<figcaption>polar spectrum of {name}</figcaption></figure>"
        )
    verdict = (
        f"Found <b>{escape(match.label or 'unknown')}</b> turned by {match.orientation_deg:.1f}°, "
        f"distance {match.distance:.4f}; next {escape(match.runner_up or '-')}. "
        f"True: {escape(entry.label)} turned by {entry.orientation_deg:.1f}°. "
        f"{surface.shadow_mask.mean():.1%} of the pixels lie in shadow of a light."
    )
    return (
        f'<section id="set-{number}"><h2>{escape(entry.label)}, '
        f"{entry.orientation_deg:.0f}°</h2><p>{verdict}</p>"
        f'<div class="figures">{"".join(figures)}</div></section>'
    )


def _jpeg(picture: pictures.Picture) -> str:
    small = cv2.resize(picture, (_PICTURE_PX, _PICTURE_PX), interpolation=cv2.INTER_AREA)
    _, buffer = cv2.imencode(".jpg", small[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
    return "data:image/jpeg;base64," + base64.b64encode(buffer.tobytes()).decode("ascii")


def _polar_plot(test: FloatMap, reference: FloatMap, turn_deg: float) -> str:
    """SVG: the test as a line, the nearest training set turned by the found angle as an area."""
    top = max(float(test.max()), float(reference.max()), 1e-12)
    return (
        f'<svg viewBox="-1.1 -1.1 2.2 2.2" width="{_PICTURE_PX}" height="{_PICTURE_PX}">'
        '<circle r="1" class="frame"/><circle r="0.5" class="frame"/>'
        f'<polygon class="reference" points="{_points(reference / top, turn_deg)}"/>'
        f'<polygon class="test" points="{_points(test / top, 0.0)}"/></svg>'
    )


def _points(radii: FloatMap, turn_deg: float) -> str:
    # Half a turn is known; the other half is the same by point symmetry.
    count = len(radii)
    points = []
    for index in range(2 * count):
        angle = math.pi * index / count + math.radians(turn_deg)
        radius = float(radii[index % count])
        points.append(f"{radius * math.cos(angle):.3f},{-radius * math.sin(angle):.3f}")
    return " ".join(points)
