"""Drawings of a calibration as SVG: LED positions, response curve, hot pixels."""

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from classify.calibration.calibration import CalibratedLights
from classify.calibration.correction import Response, Scale
from classify.calibration.dark import Dark

FloatArray = npt.NDArray[np.float64]

_SIDE = 100.0  # of a drawing, in its own units
_BELOW = 12.0  # room for the scale bar below the part, in a drawing from the side
_MARGIN = 1.25  # drawn range, as a multiple of the largest coordinate
# An ellipse of two standard errors holds a position with 86 %.
_STANDARD_ERRORS = 2.0
# Lights nearer to each other than this share their text.
_NAME_ROOM = 4.0
# More dots than this cannot be told apart, and make the page large.
_MOST_DOTS = 2000


def lights_from_above(lights: CalibratedLights, scale: Scale | None, frame: FloatArray) -> Markup:
    """Draw the lights over the frame (width, height in px): x to the right, y up."""
    return _lights(lights, scale, frame, up=1)


def lights_from_the_side(
    lights: CalibratedLights, scale: Scale | None, frame: FloatArray
) -> Markup:
    """Draw the lights above the plane of the part: x to the right, z up."""
    return _lights(lights, scale, frame, up=2)


def _lights(lights: CalibratedLights, scale: Scale | None, frame: FloatArray, up: int) -> Markup:
    """Draw the lights with the coordinate `up` upwards: 1 for y, 2 for z."""
    positions = lights.lighting.positions_px
    is_near = positions is not None
    places = lights.lighting.directions if positions is None else positions
    reach = _MARGIN * max(float(np.abs(places[:, [0, up]]).max()), 1e-9)
    if is_near:
        reach = max(reach, 0.6 * float(frame.max()))
    unit = 0.5 * _SIDE / reach
    low = 0.0 if up == 2 else -reach  # nothing is below the part
    height = _SIDE if up == 1 else 0.5 * _SIDE + _BELOW

    def at(point: FloatArray) -> tuple[float, float]:
        return 0.5 * _SIDE + unit * point[0], height - _BELOW * (up == 2) - unit * (point[up] - low)

    drawn = [_frame(frame if is_near else None, unit, up, height)]
    drawn += [_axis(at(np.zeros(3)), at(place)) for place in places]
    names: dict[tuple[float, float], list[str]] = {}
    for index, place in enumerate(places):
        x, y = at(place)
        near = [position for position in names if math.dist(position, (x, y)) < _NAME_ROOM]
        names.setdefault(near[0] if near else (x, y), []).append(str(index))
        covariance = _covariance(lights, index, place)[np.ix_([0, up], [0, up])]
        drawn.append(_ellipse(x, y, unit, covariance))
        drawn.append(f'<circle class="led" cx="{x:.2f}" cy="{y:.2f}" r="0.7"/>')
    for (x, y), shared in names.items():
        name = ", ".join(shared)
        drawn.append(f'<text x="{x + 2.5:.2f}" y="{y - 2.0:.2f}">{name}</text>')
    if is_near:
        drawn.append(_scale_bar(reach, unit, height, None if scale is None else scale.mm_per_px))
    label = "from above" if up == 1 else "from the side"
    return _svg("".join(drawn), height, f"Positions of the lights {label}")


def _covariance(lights: CalibratedLights, index: int, place: FloatArray) -> FloatArray:
    """(3, 3) covariance of a position from the errors of its direction and its distance."""
    distance = float(np.linalg.norm(place))
    along = np.outer(place, place) / distance**2
    across = np.eye(3) - along
    angle = np.radians(lights.direction_errors_deg[index])
    share = 0.0 if lights.distance_errors is None else lights.distance_errors[index]
    covariance: FloatArray = distance**2 * (share**2 * along + angle**2 * across)
    return covariance


def _ellipse(x: float, y: float, unit: float, covariance: FloatArray) -> str:
    variances, axes = np.linalg.eigh(covariance)
    radii = _STANDARD_ERRORS * unit * np.sqrt(np.maximum(variances, 0.0))
    # y of a drawing grows downwards.
    angle_deg = -np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    return (
        f'<ellipse class="error" rx="{radii[1]:.2f}" ry="{radii[0]:.2f}" '
        f'transform="translate({x:.2f} {y:.2f}) rotate({angle_deg:.1f})"/>'
    )


def _frame(frame: FloatArray | None, unit: float, up: int, height: float) -> str:
    if up == 2:
        y = height - _BELOW
        ground = f'<line class="axis" x1="0" y1="{y}" x2="{_SIDE}" y2="{y}"/>'
        if frame is None:
            return ground
        half = 0.5 * unit * frame[0]
        x1, x2 = 0.5 * _SIDE - half, 0.5 * _SIDE + half
        return ground + f'<line class="part" x1="{x1:.2f}" y1="{y}" x2="{x2:.2f}" y2="{y}"/>'
    if frame is None:
        return ""
    width, depth = unit * frame
    return (
        f'<rect class="part" x="{0.5 * (_SIDE - width):.2f}" y="{0.5 * (_SIDE - depth):.2f}" '
        f'width="{width:.2f}" height="{depth:.2f}"/>'
    )


def _axis(start: tuple[float, float], end: tuple[float, float]) -> str:
    (x1, y1), (x2, y2) = start, end
    return f'<line class="axis" x1="{x1:.2f}" y1="{y1:.2f}" x2="{x2:.2f}" y2="{y2:.2f}"/>'


def _scale_bar(reach: float, unit: float, height: float, mm_per_px: float | None) -> str:
    """A bar of 1, 2 or 5 times a power of ten, in mm or px, about a quarter of the drawing."""
    per_px, name = (1.0, "px") if mm_per_px is None else (mm_per_px, "mm")
    longest = 0.5 * reach * per_px
    power = 10.0 ** np.floor(np.log10(longest))
    length = power * max(step for step in (1.0, 2.0, 5.0) if step * power <= longest)
    width, y = unit * length / per_px, height - 3.0
    return (
        f'<line class="bar" x1="3" y1="{y}" x2="{3 + width:.2f}" y2="{y}"/>'
        f'<text x="{5 + width:.2f}" y="{y + 1.0}">{length:g} {name}</text>'
    )


def response_curve(response: Response) -> Markup:
    """Draw linear light over the pixel value, both from 0 to full scale, and a linear camera."""
    values = np.linspace(0.0, _SIDE, len(response.curve))
    points = " ".join(
        f"{x:.1f},{_SIDE * (1.0 - light):.1f}"
        for x, light in zip(values, response.curve, strict=True)
    )
    return _svg(
        f'<rect class="part" x="0" y="0" width="{_SIDE}" height="{_SIDE}"/>'
        f'<line class="axis" x1="0" y1="{_SIDE}" x2="{_SIDE}" y2="0"/>'
        f'<polyline class="curve" points="{points}"/>'
        f'<text x="{_SIDE}" y="{_SIDE - 2}" text-anchor="end">pixel value</text>'
        '<text x="2" y="6">light</text>',
        _SIDE,
        "Response of the camera",
    )


def hot_pixel_map(dark: Dark, frame: FloatArray) -> Markup:
    """Draw the places of hot pixels in the frame (width, height in px)."""
    unit = _SIDE / float(frame[0])
    height = unit * float(frame[1])

    def dots() -> Iterator[str]:
        for row, column in dark.hot_pixels[:_MOST_DOTS]:
            x, y = unit * (column + 0.5), unit * (row + 0.5)
            yield f'<circle class="hot" cx="{x:.2f}" cy="{y:.2f}" r="0.8"/>'

    rectangle = f'<rect class="part" x="0" y="0" width="{_SIDE}" height="{height:.2f}"/>'
    return _svg(rectangle + "".join(dots()), height, "Places of hot pixels")


def _svg(content: str, height: float, label: str) -> Markup:
    return Markup(
        f'<svg role="img" aria-label="{label}" viewBox="-2 -2 {_SIDE + 4:g} {height + 4:.2f}">'
        f"{content}</svg>"
    )
