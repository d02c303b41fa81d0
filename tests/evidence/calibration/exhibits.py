"""Tables and pictures of calibrated rigs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from capture.chapter.output import Exhibit, Row
from capture.chapter.plots import Scale, draw_maps

from .lights import LightErrors
from .normal_errors import IDEAL, METHODS, STEPS, SURFACES, StepErrors
from .rigs import AMBIENT, HOT_PIXELS, LED_LEVELS, VIGNETTING_PERCENT

# The errors without a calibration reach 20 degrees; those with one stay visible.
_TOP_DEG = 6.0
_MAP_IN = 2.0


def calibration_exhibits(
    errors: Sequence[StepErrors], lights: Sequence[LightErrors]
) -> Iterator[Exhibit]:
    """The table of angular errors, the maps of one rig, and the table of lights."""
    values = {
        "surfaces": ", ".join(SURFACES),
        "levels": ", ".join(map(str, LED_LEVELS)),
        "ambient": f"{100 * AMBIENT:g}",
        "vignetting": f"{VIGNETTING_PERCENT:g}",
        "hot": HOT_PIXELS,
        "size": errors[0].conditions.size_px,
    }
    rows: list[Row] = []
    for each in errors:
        for method in METHODS:
            means = each.means_deg[method]
            last = list(STEPS)[-1]
            rows.append((
                f"{each.conditions.fields:g}", each.conditions.camera, method,
                *(means[step] for step in STEPS), means[IDEAL], means[last] - means[IDEAL],
            ))  # fmt: skip
    columns = ("LEDs at, fields", "camera", "method", *STEPS, IDEAL, "more than ideal")
    yield Exhibit("calibration", columns, rows, digits=2, values=values)
    yield _maps(errors[-1], values)
    yield Exhibit(
        "calibration_lights",
        (
            "target", "LEDs at, fields", "camera", "direction, degrees", "stated",
            "distance, %", "stated, %",
        ),
        [
            (
                each.target, "distant" if each.fields is None else f"{each.fields:g}", each.camera,
                each.direction_deg, each.stated_direction_deg,
                each.distance_pct, each.stated_distance_pct,
            )
            for each in lights
        ],
        digits=2,
        values=values,
    )  # fmt: skip


def _maps(errors: StepErrors, values: dict[str, object]) -> Exhibit:
    maps = list(errors.maps_deg.items())
    scale = Scale((0.0, _TOP_DEG), "magma", "angular error, degrees")
    rig = {"fields": f"{errors.conditions.fields:g}", "camera": errors.conditions.camera}
    return Exhibit(
        "calibration_maps",
        ("solved with", "mean angular error, degrees"),
        [(step, errors.means_deg[METHODS[0]][step]) for step, _ in maps],
        draw=partial(draw_maps, maps=maps, scale=scale),
        size_in=(_MAP_IN * len(maps) + 1.0, 1.2 * _MAP_IN),
        digits=2,
        values={**values, **rig, "method": METHODS[0], "surface": SURFACES[0]},
    )
