"""Exhibits of chapter 9 that look at surfaces: shadow, relief, albedo, polar spectra."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from . import plots
from .exhibit import Exhibit, Row, exhibit
from .gallery import GALLERY_SLANT_DEG, TRUTH, SandMaps
from .plan import BEST_SOLVER, SOLVERS
from .reference import GIVEN_SAND_SHADOW
from .results import SOLVER_TITLES, Results
from .shadow_counts import SHADOW_TILTS_DEG

__all__ = ["surface_exhibits"]

_SHOWN = (TRUTH, *SOLVERS)
_SLANT = f"{GALLERY_SLANT_DEG:g}"
_PICTURES_IN = (11.0, 3.0)


def surface_exhibits(results: Results) -> Iterator[Exhibit]:
    """Figures 9.2, 9.3, 9.5 and 9.7 to 9.10."""
    yield _shadow_by_texture(results)
    yield _shadow_of_sand(results)
    yield _polar("figure_9_05", results, ("ps3a", "ps3b", "ps3c", "ps3d"))
    yield _shadow_map(results.maps)
    yield _relief(results.maps)
    yield _albedo(results.maps)
    yield _polar("figure_9_10", results, (*SOLVERS[1:], TRUTH))


def _shadow_by_texture(results: Results) -> Exhibit:
    textures = list(dict.fromkeys(texture for texture, _ in results.shadow_shares))
    slants_deg = sorted({slant_deg for _, slant_deg in results.shadow_shares})
    percents = {
        name: [100.0 * results.shadow_shares[name, slant_deg][0] for slant_deg in slants_deg]
        for name in textures
    }
    at = slants_deg.index(GALLERY_SLANT_DEG)
    by_shadow = sorted(textures, key=lambda name: percents[name][at])
    lines = tuple(plots.Line(name, slants_deg, values) for name, values in percents.items())
    return exhibit(
        "figure_9_02",
        ("slant_deg", *(f"{name}_pct" for name in textures)),
        list(zip(slants_deg, *percents.values(), strict=True)),
        draw=partial(
            plots.draw_lines,
            panels=(plots.Panel("light at tilt 0", lines),),
            x_label="slant, degrees",
            y_label="shadow count, % of pixels",
        ),
        size_in=(6.5, 4.0),
        slant=_SLANT,
        most=by_shadow[-1],
        least=by_shadow[0],
    )


def _shadow_of_sand(results: Results) -> Exhibit:
    slants_deg = sorted(slant_deg for name, slant_deg in results.shadow_shares if name == "sand")
    shares = np.array([results.shadow_shares["sand", slant_deg] for slant_deg in slants_deg])
    by_tilt = (100.0 * shares.T).tolist()
    given = [GIVEN_SAND_SHADOW.get(round(slant_deg)) for slant_deg in slants_deg]
    apart = [
        abs(ours - other)
        for ours, other in zip(by_tilt[0], given, strict=True)
        if other is not None
    ]
    lines = [
        plots.Line(f"tilt {tilt_deg:g}", slants_deg, values)
        for tilt_deg, values in zip(SHADOW_TILTS_DEG, by_tilt, strict=True)
    ]
    lines.append(plots.Line("given for tilt 0", slants_deg, given, style="x", colour="#000000"))
    tilts = [f"tilt_{tilt_deg:g}_pct" for tilt_deg in SHADOW_TILTS_DEG]
    return exhibit(
        "figure_9_03",
        ("slant_deg", *tilts, "given_tilt_0_pct"),
        list(zip(slants_deg, *by_tilt, given, strict=True)),
        draw=partial(
            plots.draw_lines,
            panels=(plots.Panel("sand", tuple(lines)),),
            x_label="slant, degrees",
            y_label="shadow count, % of pixels",
        ),
        size_in=(6.5, 4.0),
        apart=f"{max(apart):.1f}",
    )


def _polar(key: str, results: Results, solvers: Sequence[str]) -> Exhibit:
    turns_deg = sorted(results.polar)
    panels = [
        (
            SOLVER_TITLES[solver],
            [(f"{turn_deg:g}°", results.polar[turn_deg][solver]) for turn_deg in turns_deg],
        )
        for solver in solvers
    ]
    spreads = []
    for solver in dict.fromkeys((*solvers, TRUTH)):
        lobes = [max(results.polar[turn_deg][solver]) for turn_deg in turns_deg]
        spreads.append(f"{SOLVER_TITLES[solver]} {max(lobes) / min(lobes):.2f}")
    rows: list[Row] = [
        (solver, turn_deg, 2.0 * index, value)
        for solver in solvers
        for turn_deg in turns_deg
        for index, value in enumerate(results.polar[turn_deg][solver])
    ]
    return exhibit(
        key,
        ("solver", "turn_deg", "angle_deg", "m"),
        rows,
        draw=partial(plots.draw_polar, panels=panels),
        size_in=(2.6 * len(panels) + 0.6, 3.1),
        slant=_SLANT,
        spreads=", ".join(spreads),
    )


def _shadow_map(maps: SandMaps) -> Exhibit:
    rows: list[Row] = [
        (name, *(100.0 * float((maps.shadows[name] == count).mean()) for count in range(5)))
        for name in _SHOWN
    ]
    return exhibit(
        "figure_9_07",
        ("map", *(f"{count}_lights_pct" for count in range(5))),
        rows,
        draw=partial(
            plots.draw_pictures,
            pictures=[(SOLVER_TITLES[name], maps.shadows[name]) for name in _SHOWN],
            value_range=(0.0, 4.0),
            colours="cividis",
            label="lights in shadow",
        ),
        size_in=_PICTURES_IN,
        slant=_SLANT,
    )


def _relief(maps: SandMaps) -> Exhibit:
    top = float(np.percentile(np.abs(maps.relief[TRUTH]), 99.5))
    slope_errors = {name: float(np.hypot(*errors[:2])) for name, errors in maps.errors.items()}
    return exhibit(
        "figure_9_08",
        ("solver", "rms_error_p", "rms_error_q"),
        [(name, *maps.errors[name][:2]) for name in SOLVERS],
        draw=partial(
            plots.draw_pictures,
            pictures=[(SOLVER_TITLES[name], maps.relief[name]) for name in _SHOWN],
            value_range=(-top, top),
            colours="gray",
            label="relative height, px",
        ),
        size_in=_PICTURES_IN,
        digits=3,
        slant=_SLANT,
        best=BEST_SOLVER,
        **_gains(slope_errors),
    )


def _albedo(maps: SandMaps) -> Exhibit:
    errors = {name: values[2] for name, values in maps.errors.items()}
    return exhibit(
        "figure_9_09",
        ("solver", "rms_error_albedo"),
        [(name, errors[name]) for name in SOLVERS],
        draw=partial(
            plots.draw_pictures,
            pictures=[(SOLVER_TITLES[name], maps.albedo[name]) for name in _SHOWN],
            value_range=(0.0, 1.2),
            colours="gray",
            label="albedo",
        ),
        size_in=_PICTURES_IN,
        digits=3,
        slant=_SLANT,
        best=BEST_SOLVER,
        **_gains(errors),
    )


def _gains(errors: dict[str, float]) -> dict[str, str]:
    """How many times larger the error of PS3a is than that of the others."""
    return {
        "gain_ps4": f"{errors['ps3a'] / errors['ps4']:.1f}",
        "gain_best": f"{errors['ps3a'] / errors[BEST_SOLVER]:.1f}",
    }
