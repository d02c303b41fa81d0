"""Drawings of a calibration: LED positions, response curve, hot pixels."""

from collections import defaultdict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle

from classify.base.arrays import Floats
from classify.calibration.calibration import CalibratedLights
from classify.calibration.correction import Response, Scale
from classify.calibration.dark import Dark

_SIDE_IN = 3.2
_MARGIN = 1.25  # drawn range, as a multiple of the largest coordinate
# An ellipse of two standard errors holds a position with 86 %.
_STANDARD_ERRORS = 2.0
# More dots than this cannot be told apart, and make the page large.
_MOST_DOTS = 2000
_LED, _ERROR, _GREY = "#d6a400", "#b2182b", "#cccccc"


def lights_from_above(lights: CalibratedLights, scale: Scale | None, frame: Floats) -> Figure:
    """Draw the lights over the frame (width, height in px): x to the right, y up."""
    return _lights(lights, scale, frame, up=1)


def lights_from_the_side(lights: CalibratedLights, scale: Scale | None, frame: Floats) -> Figure:
    """Draw the lights above the plane of the part: x to the right, z up."""
    return _lights(lights, scale, frame, up=2)


def _lights(lights: CalibratedLights, scale: Scale | None, frame: Floats, up: int) -> Figure:
    """Draw the lights with the coordinate `up` upwards: 1 for y, 2 for z."""
    positions = lights.lighting.positions_px
    per_px, unit = (1.0, "px") if scale is None else (scale.mm_per_px, "mm")
    places = lights.lighting.directions if positions is None else per_px * positions
    figure, axes = _figure()
    reach = float(np.abs(places[:, [0, up]]).max())
    if positions is not None:
        axes.set_xlabel(unit)
        width, depth = per_px * frame
        height = depth if up == 1 else 0.0
        axes.add_patch(Rectangle((-0.5 * width, -0.5 * height), width, height, fill=False))
        reach = max(reach, 0.5 * per_px * float(frame.max()))
    names: defaultdict[tuple[float, float], list[str]] = defaultdict(list)
    for index, place in enumerate(places):
        point = place[[0, up]]
        axes.plot([0.0, point[0]], [0.0, point[1]], color=_GREY, linewidth=0.8, zorder=0)
        covariance = _covariance(lights, index, place)[np.ix_([0, up], [0, up])]
        axes.add_patch(_ellipse(point, covariance))
        x, y = (point / reach).round(1) + 0.0
        names[float(x), float(y)].append(str(index))
    axes.scatter(places[:, 0], places[:, up], s=8, color=_LED)
    for (x, y), indices in names.items():  # lights behind each other share their text
        axes.annotate(
            ", ".join(indices), (reach * x, reach * y), (3, 3), fontsize=7,
            textcoords="offset points",
        )  # fmt: skip
    axes.set_xlim(-_MARGIN * reach, _MARGIN * reach)
    axes.set_ylim(-_MARGIN * reach if up == 1 else -0.1 * reach, _MARGIN * reach)
    return figure


def _covariance(lights: CalibratedLights, index: int, place: Floats) -> Floats:
    """(3, 3) covariance of a position from the errors of its direction and its distance."""
    distance = float(np.linalg.norm(place))
    along = np.outer(place, place) / distance**2
    across = np.eye(3) - along
    angle = np.radians(lights.direction_errors_deg[index])
    share = 0.0 if lights.distance_errors is None else lights.distance_errors[index]
    covariance: Floats = distance**2 * (share**2 * along + angle**2 * across)
    return covariance


def _ellipse(point: Floats, covariance: Floats) -> Ellipse:
    variances, axes = np.linalg.eigh(covariance)
    height, width = 2.0 * _STANDARD_ERRORS * np.sqrt(np.maximum(variances, 0.0))
    angle_deg = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
    return Ellipse((point[0], point[1]), width, height, angle=angle_deg, color=_ERROR, alpha=0.5)


def response_curve(response: Response) -> Figure:
    """Draw linear light over the pixel value, both from 0 to full scale, and a linear camera."""
    figure, axes = _figure()
    axes.plot([0.0, 1.0], [0.0, 1.0], color=_GREY)
    axes.plot(np.linspace(0.0, 1.0, len(response.curve)), response.curve)
    axes.set_xlabel("pixel value / full scale")
    axes.set_ylabel("light")
    return figure


def hot_pixel_map(dark: Dark, frame: Floats) -> Figure:
    """Draw the places of hot pixels in the frame (width, height in px)."""
    figure, axes = _figure()
    rows, columns = dark.hot_pixels[:_MOST_DOTS].T
    axes.scatter(columns, rows, s=6, color=_ERROR)
    axes.set_xlim(-0.5, frame[0] - 0.5)
    axes.set_ylim(frame[1] - 0.5, -0.5)
    return figure


def _figure() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(_SIDE_IN, _SIDE_IN), layout="constrained")
    axes = figure.subplots()
    axes.set_aspect("equal")
    axes.tick_params(labelsize=7)
    return figure, axes
