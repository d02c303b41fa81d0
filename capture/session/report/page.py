"""The report of a session as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from importlib.metadata import version
from pathlib import Path
from string import Template

import cv2
import numpy as np

from capture.maps import pictures
from capture.maps.figures import data_uri, number_text
from capture.session.folder import SessionFolder
from capture.session.plan import Specimen

from . import figures
from .analysis import SessionAnalysis, SpecimenResult

_TEMPLATE = Path(__file__).with_name("page.html")
_TILE_PX = 160
_SIMULATED = '<p class="notice"><b>Simulated.</b> No light, camera or specimen is real.</p>'


def report_page(folder: SessionFolder, found: SessionAnalysis) -> str:
    """Return the page as HTML; all text from plan, journal and sets is escaped."""
    sections = {
        "To look at": _remarks(found),
        "Levels over time": _image(figures.levels_figure(found.entries), "Levels of the lights"),
        "Orientation": _image(
            figures.orientations_figure(found.entries), "Estimated less entered orientation"
        ),
        "How the textures separate": _separation(found),
        "Specimens": "".join(
            _specimen(folder.plan.specimen_named(name), each, found)
            for name, each in found.specimens.items()
            if name in {specimen.id for specimen in folder.plan.specimen}
        ),
        "Sets": _sets(found),
    }
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=escape(folder.plan.name),
        notice=_SIMULATED * any(run.simulated for run in folder.journal.runs),
        facts="".join(
            f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"
            for name, value in _facts(folder)
        ),
        sections="".join(f"<h2>{name}</h2>{content}" for name, content in sections.items()),
        version=escape(version("ps4rig")),
    )


def _facts(folder: SessionFolder) -> Iterator[tuple[str, str]]:
    journal, missing = folder.journal, len(folder.missing())
    captured = sum(entry.file is not None for entry in journal.entries)
    skipped = sum(entry.skipped is not None for entry in journal.entries)
    yield "operator", folder.plan.operator or "-"
    yield "specimens", str(len(folder.plan.specimen))
    yield "orientations", str(len(folder.plan.orientations_deg))
    yield "sets", f"{captured} captured, {skipped} left out, {missing} missing"
    if journal.runs:
        yield "runs", f"{len(journal.runs)}, from {journal.runs[0].started_utc}"
        yield "rig", journal.runs[-1].rig
    yield "size", f"{folder.bytes_of_sets() / 1e6:.0f} MB"


def _remarks(found: SessionAnalysis) -> str:
    if not found.remarks:
        return "<p>Nothing stands out.</p>"
    rows = "".join(
        f"<tr><td>{escape(file)}</td><td>{escape(said)}</td></tr>" for file, said in found.remarks
    )
    return f'<div class="table"><table><tr><th>set</th><th>what</th></tr>{rows}</table></div>'


def _separation(found: SessionAnalysis) -> str:
    separation = found.separation
    if separation is None:
        return "<p>It takes two specimens with a texture to compare.</p>"
    return (
        "<p>Distances as the classifier measures them, before any training: 1 is typical of two "
        "quarters of one frame. In the plane near sets look alike; one colour and mark is one "
        "specimen.</p>"
        + _image(figures.matrix_figure(separation), "Distances of specimens and their grouping")
        + _image(figures.map_figure(separation), "Map of all sets")
    )


def _specimen(specimen: Specimen, result: SpecimenResult, found: SessionAnalysis) -> str:
    captured, surface = result.loaded.captured, result.surface
    tiles = {
        **pictures.light_images(captured, 4),
        "albedo": pictures.grey(surface.albedo),
        "relief": pictures.shaded(surface.normals),
    }
    images = [
        f'<figure><img alt="{escape(name)}" src="{data_uri(_small(tile))}">'
        f"<figcaption>{escape(name)}</figcaption></figure>"
        for name, tile in tiles.items()
    ]
    if result.spectra is not None:
        images.append(
            f'<figure><img alt="polar spectra" src="{figures.spectrum_figure(result.spectra)}">'
            "<figcaption>polar spectra of gradient (blue) and albedo (red)</figcaption></figure>"
        )
    count = sum(entry.specimen == specimen.id for entry in found.entries)
    label, note = specimen.label or specimen.id, f", {specimen.note}" if specimen.note else ""
    return (
        f"<h3>{escape(specimen.id)}</h3><p>class {escape(label)}{escape(note)}, {count} sets</p>"
        f'<div class="tiles">{"".join(images)}</div>'
    )


def _sets(found: SessionAnalysis) -> str:
    head = ("set", "entered", "estimated", "saturated", "in shadow", "focus, px", "levels")
    rows = []
    for entry in found.entries:
        measures = entry.measures
        cells = [f"<td>{escape(str(entry.file))}</td>", _value(entry.orientation_deg)]
        if measures is not None:
            blur_px = measures.blur_px
            cells += [
                _value(measures.estimated_deg),
                f'<td class="value">{measures.saturated:.1%}</td>',
                f'<td class="value">{measures.shadowed:.1%}</td>',
                _value(None if blur_px is None else round(-blur_px, 2)),
                f"<td>{' '.join(f'{level:.1%}' for level in measures.led_levels)}</td>",
            ]
        rows.append(f"<tr>{''.join(cells)}</tr>")
    heads = "".join(f"<th>{each}</th>" for each in head)
    return f'<div class="table"><table><tr>{heads}</tr>{"".join(rows)}</table></div>'


def _value(value: float | None) -> str:
    return f'<td class="value">{"-" if value is None else number_text(value)}</td>'


def _small(picture: pictures.Picture) -> pictures.Picture:
    scale = _TILE_PX / max(picture.shape[:2])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def _image(address: str, name: str) -> str:
    return f'<figure><img alt="{escape(name)}" src="{address}"></figure>'
