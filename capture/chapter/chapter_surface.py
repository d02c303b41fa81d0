"""Exhibits of chapter 9 that show surfaces: shadow, relief, albedo, polar spectra."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from . import plots
from .output import Exhibit, Row
from .plan import BEST_SOLVER, SOLVERS
from .results import SAND_SLANT_DEG, SHADOW_TILTS_DEG, SOLVER_TITLES, TRUTH, Results

# Share of the pixels of sand in shadow of a light at tilt 0, in percent, by slant: figure 9.3.
_THESIS_SAND_SHADOW_PCT = {40: 1.0, 50: 7.0, 60: 19.0, 70: 37.0, 80: 61.0}

_SHOWN = (TRUTH, *SOLVERS)
_SLANT = f"{SAND_SLANT_DEG:g}"


def surface_exhibits(results: Results) -> Iterator[Exhibit]:
    """Make figures 9.2, 9.3, 9.5 and 9.7 to 9.10."""
    maps = results.maps
    yield _shadow_by_texture(results)
    yield _shadow_of_sand(results)
    yield _polar("figure_9_05", results, ("ps3a", "ps3b", "ps3c", "ps3d"))
    shares: list[Row] = [
        (name, *(100.0 * float((maps.shadows[name] == count).mean()) for count in range(5)))
        for name in _SHOWN
    ]
    columns = ("map", *(f"{count}_lights_pct" for count in range(5)))
    scale = plots.Scale((0.0, 4.0), "cividis", "lights in shadow")
    yield _maps("figure_9_07", columns, shares, maps.shadows, scale, digits=1)
    top = float(np.percentile(np.abs(maps.relief[TRUTH]), 99.5))
    yield _maps(
        "figure_9_08",
        ("solver", "rms_error_p", "rms_error_q"),
        [(name, *maps.errors[name][:2]) for name in SOLVERS],
        maps.relief,
        plots.Scale((-top, top), "gray", "relative height, px"),
        {name: float(np.hypot(*errors[:2])) for name, errors in maps.errors.items()},
    )
    albedo_errors = {name: errors[2] for name, errors in maps.errors.items()}
    yield _maps(
        "figure_9_09",
        ("solver", "rms_error_albedo"),
        [(name, albedo_errors[name]) for name in SOLVERS],
        maps.albedo,
        plots.Scale((0.0, 1.2), "gray", "albedo"),
        albedo_errors,
    )
    yield _polar("figure_9_10", results, (*SOLVERS[1:], TRUTH))


def _shadow_by_texture(results: Results) -> Exhibit:
    shares = results.shadow_shares
    slants_deg = sorted({slant_deg for _, slant_deg in shares})
    lines = [
        plots.Line(
            name, slants_deg, [100.0 * shares[name, slant_deg][0] for slant_deg in slants_deg]
        )
        for name in dict.fromkeys(name for name, _ in shares)
    ]
    columns = [f"{line.label}_pct" for line in lines]
    return _shadow("figure_9_02", columns, "light at tilt 0", lines)


def _shadow_of_sand(results: Results) -> Exhibit:
    slants_deg = sorted(slant_deg for name, slant_deg in results.shadow_shares if name == "sand")
    shares = np.array([results.shadow_shares["sand", slant_deg] for slant_deg in slants_deg])
    thesis = [_THESIS_SAND_SHADOW_PCT.get(round(slant_deg)) for slant_deg in slants_deg]
    lines = [
        plots.Line(f"tilt {tilt_deg:g}", slants_deg, values)
        for tilt_deg, values in zip(SHADOW_TILTS_DEG, (100.0 * shares.T).tolist(), strict=True)
    ]
    lines.append(plots.Line("thesis, tilt 0", slants_deg, thesis, style="x", colour="#000000"))
    tilts = [f"tilt_{tilt_deg:g}_pct" for tilt_deg in SHADOW_TILTS_DEG]
    return _shadow("figure_9_03", [*tilts, "thesis_tilt_0_pct"], "sand", lines)


def _shadow(key: str, columns: list[str], title: str, lines: list[plots.Line]) -> Exhibit:
    return Exhibit(
        key,
        ("slant_deg", *columns),
        list(zip(lines[0].x, *(line.y for line in lines), strict=True)),
        draw=partial(
            plots.draw_lines,
            panels=((title, lines),),
            x_label="slant, degrees",
            y_label="shadow count, % of pixels",
        ),
        size_in=(6.5, 4.0),
    )


def _polar(key: str, results: Results, solvers: Sequence[str]) -> Exhibit:
    polar = results.polar
    orientations_deg = sorted(polar)
    panels = [
        (SOLVER_TITLES[solver], [(f"{deg:g}°", polar[deg][solver]) for deg in orientations_deg])
        for solver in solvers
    ]
    ratios = []
    for solver in dict.fromkeys((*solvers, TRUTH)):
        lobes = [max(polar[deg][solver]) for deg in orientations_deg]
        ratios.append(f"{SOLVER_TITLES[solver]} {max(lobes) / min(lobes):.2f}")
    rows: list[Row] = [
        (solver, deg, 2.0 * index, value)
        for solver in solvers
        for deg in orientations_deg
        for index, value in enumerate(polar[deg][solver])
    ]
    return Exhibit(
        key,
        ("solver", "orientation_deg", "angle_deg", "m"),
        rows,
        draw=partial(plots.draw_polar, panels=panels),
        size_in=(2.6 * len(panels) + 0.6, 3.7),
        values={"slant": _SLANT, "ratios": ", ".join(ratios)},
    )


def _maps(
    key: str,
    columns: Sequence[str],
    rows: list[Row],
    maps: Mapping[str, npt.NDArray[np.generic]],
    scale: plots.Scale,
    errors: Mapping[str, float] | None = None,
    digits: int = 3,
) -> Exhibit:
    """Maps of the solvers and the truth; the caption has ratios of the error of PS3a."""
    values = {"slant": _SLANT}
    if errors is not None:
        values["gain_ps4"] = f"{errors['ps3a'] / errors['ps4']:.1f}"
        values["gain_best"] = f"{errors['ps3a'] / errors[BEST_SOLVER]:.1f}"
    shown = [(SOLVER_TITLES[name], maps[name]) for name in _SHOWN]
    draw = partial(plots.draw_maps, maps=shown, scale=scale)
    return Exhibit(key, columns, rows, draw, (11.0, 3.0), digits, values)
