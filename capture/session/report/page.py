"""The report of a session as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

from capture.base.page import image_html, number_text, page_html, simulated_notice, table_html
from capture.base.utc_time import readable_utc
from capture.maps import pictures
from capture.maps.figures import tile_html
from capture.session.folder import SessionFolder
from capture.sets.description import plain

from . import figures
from .analysis import SessionAnalysis, SpecimenResult


def report_page(folder: SessionFolder, found: SessionAnalysis) -> str:
    """Return the page as HTML; all text from plan, journal and sets is escaped."""
    sections = {
        "To look at": _remarks(found),
        "Levels over time": image_html(
            figures.levels_figure(found.entries), "Levels of the lights"
        ),
        "Orientation": image_html(
            figures.orientations_figure(found.entries), "Estimated less entered orientation"
        ),
        "How the textures separate": _separation(found),
        "Specimens": "".join(
            _specimen(name, each, found) for name, each in found.specimens.items()
        ),
        "Sets": _sets(found),
    }
    return page_html(
        folder.plan.name,
        "session",
        sections,
        facts=_facts(folder, found),
        notices=[simulated_notice("specimen") * any(run.simulated for run in folder.journal.runs)],
        note="Orientations in degrees, anticlockwise, modulo 180 where estimated.",
    )


def _facts(folder: SessionFolder, found: SessionAnalysis) -> Iterator[tuple[str, str]]:
    journal, missing = folder.journal, len(folder.missing())
    captured, skipped = len(folder.captured()), len(folder.left_out())
    yield "operator", folder.plan.operator or "-"
    yield "specimens", str(len(folder.plan.specimen))
    yield "orientations", str(len(folder.plan.orientations_deg))
    unplanned = len(folder.unplanned())
    yield (
        "sets",
        f"{captured} captured, {skipped} left out, {missing} missing"
        + (f"; {len(found.damaged)} of the captured ones cannot be read" if found.damaged else "")
        + (f"; {unplanned} of the captured ones are no longer planned" if unplanned else ""),
    )
    if journal.runs:
        yield "runs", f"{len(journal.runs)}, from {readable_utc(journal.runs[0].started_utc)}"
        yield "rig", journal.runs[-1].rig
    yield "size", f"{folder.bytes_of_sets() / 1e6:.0f} MB"


def _remarks(found: SessionAnalysis) -> str:
    damaged = [(file, f"cannot be read: {error}") for file, error in found.damaged.items()]
    if not damaged and not found.remarks:
        return "<p>Nothing stands out.</p>"
    rows = (
        f"<tr><td>{escape(file)}</td><td>{escape(said)}</td></tr>"
        for file, said in [*damaged, *found.remarks]
    )
    return table_html(("set", "what"), rows)


def _separation(found: SessionAnalysis) -> str:
    separation = found.separation
    if separation is None:
        return "<p>It takes two specimens with a texture to compare.</p>"
    return (
        "<p>Distances as the classifier measures them, before any training: 1 is typical of two "
        "quarters of one frame. In the plane near sets look alike; one colour and mark is one "
        "specimen.</p>"
        + image_html(figures.matrix_figure(separation), "Distances of specimens and their grouping")
        + image_html(figures.map_figure(separation), "Map of all sets")
    )


def _specimen(name: str, result: SpecimenResult, found: SessionAnalysis) -> str:
    captured, surface = result.loaded.captured, result.surface
    tiles = {
        **pictures.light_images(captured, 4),
        "albedo": pictures.grey(surface.albedo),
        "relief": pictures.shaded(surface.normals),
    }
    images = [tile_html(title, tile) for title, tile in tiles.items()]
    if result.spectra is not None:
        caption = "polar spectra of gradient (blue) and albedo (red)"
        images.append(image_html(figures.spectrum_figure(result.spectra), "polar spectra", caption))
    entries = [entry for entry in found.entries if entry.piece == name]
    label, note = captured.label or "-", captured.metadata.note
    values: dict[str, dict[str, None]] = {}  # in order, each once
    for said in (entry.description for entry in entries if entry.description is not None):
        for key, value in said.properties.items():
            values.setdefault(key, {})[str(plain(value))] = None
    properties = [f"{key} = {' or '.join(each)}" for key, each in values.items()]
    about = [f"class {label}", *([note] if note else []), *properties, f"{len(entries)} sets"]
    shown = f'<p>{escape(", ".join(about))}</p><div class="tiles">{"".join(images)}</div>'
    return f"<h3>{escape(name)}</h3>{shown}"


def _sets(found: SessionAnalysis) -> str:
    head = ("set", "entered", "estimated", "saturated", "in shadow", "focus, px", "levels")
    rows = []
    for entry in found.entries:
        measures = entry.measures
        cells = [f"<td>{escape(str(entry.file))}</td>", _value(entry.entered_deg)]
        if measures is not None:
            blur_px = measures.blur_px
            cells += [
                _value(measures.estimated_deg, 1),
                f'<td class="value">{measures.saturated:.1%}</td>',
                f'<td class="value">{measures.shadowed:.1%}</td>',
                _value(None if blur_px is None else -blur_px, 2),
                f"<td>{' '.join(f'{level:.1%}' for level in measures.led_levels)}</td>",
            ]
        rows.append(f"<tr>{''.join(cells)}</tr>")
    return table_html(head, rows)


def _value(value: float | None, digits: int | None = None) -> str:
    if value is not None and digits is not None:
        value = round(value, digits) + 0.0  # no -0
    return f'<td class="value">{"-" if value is None else number_text(value)}</td>'
