"""The report of a session as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import ConciseDateFormatter
from matplotlib.figure import Figure

from capture.base.chart import GRID, LETTERS_PT, chart_axes, curve_colour, svg_uri
from capture.base.page import rendered
from capture.base.utc_time import readable_utc
from capture.maps import pictures
from capture.maps.pictures import tile_uri
from capture.sets.description import exact_value
from classify import Spectra
from classify.lighting import orientation_near

from .folder import SessionFolder
from .journal import SetEntry
from .report_analysis import Separation, SessionAnalysis, SpecimenResult

_MARKERS = "osD^v<>Ph*"
# 10 markers and 8 colours repeat together after lcm(10, 8) = 40 curves.
_MAX_LEGEND_ENTRIES = 40


def _levels_figure(entries: Sequence[SetEntry]) -> str:
    """Draw the level of each light over time, relative to the first set of each specimen."""
    figure, axes = chart_axes(2.8)
    first: dict[tuple[str, int], tuple[float, ...]] = {}
    # A session may be resumed on a rig with another number of lights.
    curves: dict[int, list[tuple[float, float]]] = {}
    for entry in entries:
        if entry.measures is None or entry.captured_utc is None:
            continue
        levels = entry.measures.led_levels
        base = first.setdefault((entry.entered_specimen, len(levels)), levels)
        days = datetime.fromisoformat(entry.captured_utc).timestamp() / 86_400.0
        for light, value in enumerate(100.0 * np.array(levels) / np.maximum(base, 1e-6)):
            curves.setdefault(light, []).append((days, value))
    for light, curve in sorted(curves.items()):
        axes.plot(
            *zip(*curve, strict=True),
            ".-", linewidth=0.8, color=curve_colour(light), label=f"LED {light}",
        )  # fmt: skip
    axes.set_ylabel("% of the first set")
    axes.xaxis_date()
    formatter = ConciseDateFormatter(axes.xaxis.get_major_locator())  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_formatter(formatter)
    axes.set_xlabel("time, UTC")
    _legend(figure, axes)
    return svg_uri(figure)


def _orientations_figure(entries: Sequence[SetEntry]) -> str:
    """Draw how far the estimated orientation of each set is from the entered one."""
    figure, axes = chart_axes(2.8)
    for number, specimen in enumerate(dict.fromkeys(entry.entered_specimen for entry in entries)):
        points = [
            (entry.entered_deg, error_deg)
            for entry in entries
            if entry.entered_specimen == specimen
            and (error_deg := _orientation_error_deg(entry)) is not None
        ]
        if points:
            axes.plot(
                *zip(*points, strict=True), _marker(number), markersize=4,
                color=curve_colour(number), label=specimen,
            )  # fmt: skip
    axes.axhline(0.0, color=GRID, zorder=0)
    axes.set_xlabel("entered, degrees")
    axes.set_ylabel("estimated - entered")
    _legend(figure, axes)
    return svg_uri(figure)


def _orientation_error_deg(entry: SetEntry) -> float | None:
    """Estimated less entered orientation, [-90, 90); None where none was estimated."""
    entered_deg = entry.entered_deg
    if entry.measures is None or entry.measures.estimated_deg is None or entered_deg is None:
        return None
    # Folded anew, because the entered orientation may have been corrected.
    return orientation_near(entry.measures.estimated_deg, entered_deg) - entered_deg


def _matrix_figure(separation: Separation) -> str:
    """Draw the dissimilarities of the specimens, in the order of their dendrogram."""
    figure, axes = chart_axes(_figure_height_inches(separation))
    axes.grid(visible=False)
    order = separation.tree.order
    image = axes.imshow(separation.dissimilarities[np.ix_(order, order)], cmap="viridis")
    names = _names_in_order(separation)
    axes.set_xticks(range(len(names)), names, rotation=90)
    axes.set_yticks(range(len(names)), names)
    figure.colorbar(image, ax=axes, shrink=0.7, label="distance")
    return svg_uri(figure)


def _tree_figure(separation: Separation) -> str:
    """Draw the dendrogram of the specimens."""
    figure, axes = chart_axes(_figure_height_inches(separation))
    axes.grid(visible=False)
    for branch in separation.tree.branches:
        axes.plot(branch[:, 0], branch[:, 1], color=curve_colour(0), linewidth=1.0)
    names = _names_in_order(separation)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_yticks(range(len(names)), names)
    axes.yaxis.tick_right()
    axes.set_xlabel("distance at which groups join")
    axes.invert_xaxis()
    return svg_uri(figure)


def _names_in_order(separation: Separation) -> list[str]:
    return [separation.specimens[index] for index in separation.tree.order]


def _figure_height_inches(separation: Separation) -> float:
    """Figure height with a line of text for each specimen."""
    return max(3.6, 0.16 * len(separation.specimens))


def _map_figure(separation: Separation) -> str:
    """Draw the sets at their `map_positions`: sets that look alike lie near each other."""
    figure, axes = chart_axes(3.6)
    for number, specimen in enumerate(separation.specimens):
        of_specimen = [entry.entered_specimen == specimen for entry in separation.entries]
        axes.plot(
            *separation.map_positions[of_specimen].T, _marker(number), markersize=5,
            color=curve_colour(number), label=specimen, alpha=0.8,
        )  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    _legend(figure, axes)
    return svg_uri(figure)


def _spectrum_figure(spectra: Spectra) -> str:
    """Draw the polar spectra of gradient and albedo of a specimen."""
    figure = Figure(figsize=(2.0, 2.0), layout="constrained")
    axes = figure.add_subplot(projection="polar")
    for number, values in enumerate(spectra.polar):
        # 180 degrees twice, and the first value again, give a closed curve.
        curve = np.concatenate([values, values, values[:1]]) / max(float(values.max()), 1e-12)
        angles = np.linspace(0.0, 2.0 * np.pi, len(curve))
        axes.plot(angles, curve, color=curve_colour(number), linewidth=1.0)
    axes.set_yticklabels([])
    axes.tick_params(labelsize=LETTERS_PT)
    return svg_uri(figure)


def _legend(figure: Figure, axes: Axes) -> None:
    handles, _ = axes.get_legend_handles_labels()
    if 0 < len(handles) <= _MAX_LEGEND_ENTRIES:
        figure.legend(fontsize=LETTERS_PT, loc="outside lower center", ncols=4, frameon=False)


def _marker(number: int) -> str:
    """Return the marker of a specimen; see `_MAX_LEGEND_ENTRIES`."""
    return _MARKERS[number % len(_MARKERS)]


def report_page(folder: SessionFolder, analysis: SessionAnalysis) -> str:
    """Return the page as HTML."""
    damaged = [(file, f"cannot be read: {error}") for file, error in analysis.damaged.items()]
    return rendered(
        "session/report.html",
        title=folder.plan.name,
        is_simulated=any(run.simulated for run in folder.journal.runs),
        facts=_facts(folder, analysis),
        remarks=damaged + analysis.remarks,
        levels=_levels_figure(analysis.entries),
        orientations=_orientations_figure(analysis.entries),
        entries=analysis.entries,
        repeatability=analysis.repeatability,
        separation=[]
        if analysis.separation is None
        else [draw(analysis.separation) for draw in (_matrix_figure, _tree_figure, _map_figure)],
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
    entries = [entry for entry in analysis.entries if entry.entered_specimen == name]
    values: dict[str, dict[str, None]] = {}  # distinct texts of each property, in order
    for entry in entries:
        if entry.description is not None:
            for key, value in entry.description.properties.items():
                values.setdefault(key, {})[str(exact_value(value))] = None
    properties = [f"{key} = {' or '.join(texts)}" for key, texts in values.items()]
    note = [captured.metadata.note] if captured.metadata.note else []
    return {
        "name": name,
        "facts": [f"class {captured.label or '-'}", *note, *properties, f"{len(entries)} sets"],
        "tiles": {title: tile_uri(picture) for title, picture in tiles.items()},
        "spectra": None if result.spectra is None else _spectrum_figure(result.spectra),
    }
