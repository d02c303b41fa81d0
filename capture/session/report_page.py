"""The report of a session as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from capture.base.page import rendered
from capture.base.utc_time import readable_utc
from capture.maps import pictures
from capture.maps.pictures import tile_uri
from capture.sets.description import plain

from . import report_figures as figures
from .folder import SessionFolder
from .report_analysis import SessionAnalysis, SpecimenResult


def report_page(folder: SessionFolder, analysis: SessionAnalysis) -> str:
    """Return the page as HTML."""
    damaged = [(file, f"cannot be read: {error}") for file, error in analysis.damaged.items()]
    return rendered(
        "session/report.html",
        title=folder.plan.name,
        is_simulated=any(run.simulated for run in folder.journal.runs),
        facts=_facts(folder, analysis),
        remarks=damaged + analysis.remarks,
        figures=figures,
        entries=analysis.entries,
        separation=analysis.separation,
        specimens=[
            _specimen(name, result, analysis) for name, result in analysis.specimens.items()
        ],
    )


def _facts(folder: SessionFolder, analysis: SessionAnalysis) -> Iterator[tuple[str, str]]:
    journal, missing = folder.journal, len(folder.missing())
    captured, skipped = len(folder.captured()), len(folder.left_out())
    yield "operator", folder.plan.operator or "-"
    yield "specimens", str(len(folder.plan.specimen))
    yield "orientations", str(len(folder.plan.orientations_deg))
    unplanned = len(folder.unplanned())
    yield (
        "sets",
        f"{captured} captured, {skipped} left out, {missing} missing"
        + (
            f"; {len(analysis.damaged)} of the captured ones cannot be read"
            if analysis.damaged
            else ""
        )
        + (f"; {unplanned} of the captured ones are no longer planned" if unplanned else ""),
    )
    if journal.runs:
        yield "runs", f"{len(journal.runs)}, from {readable_utc(journal.runs[0].started_utc)}"
        yield "rig", journal.runs[-1].rig
    yield "size", f"{folder.bytes_of_sets() / 1e6:.0f} MB"


def _specimen(name: str, result: SpecimenResult, analysis: SessionAnalysis) -> dict[str, Any]:
    captured, surface = result.loaded.captured, result.surface
    tiles = {
        **pictures.light_images(captured, 4),
        "albedo": pictures.grey(surface.albedo),
        "relief": pictures.shaded(surface.normals),
    }
    entries = [entry for entry in analysis.entries if entry.piece == name]
    values: dict[str, dict[str, None]] = {}  # distinct texts of each property, in order
    for entry in entries:
        if entry.description is not None:
            for key, value in entry.description.properties.items():
                values.setdefault(key, {})[str(plain(value))] = None
    properties = [f"{key} = {' or '.join(texts)}" for key, texts in values.items()]
    note = [captured.metadata.note] if captured.metadata.note else []
    return {
        "name": name,
        "facts": [f"class {captured.label or '-'}", *note, *properties, f"{len(entries)} sets"],
        "tiles": {title: tile_uri(picture) for title, picture in tiles.items()},
        "spectra": result.spectra,
    }
