"""Benefit of a calibration: errors of normals with and without its parts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from classify.base.arrays import Floats

from .calibration.calibration import Calibration, Response
from .calibration.drift_model import led_strength
from .lighting import Lighting, angles_between_deg
from .lights.flat_field import coordinates
from .solvers.solver import photometric_stereo

# The part is an egg crate of this slope. Its period is no multiple of a pixel, so that all slopes
# occur.
_LONGER_SIDE_PX, _SLOPE, _PERIOD_PX = 128, 0.3, 7.3
# Brightest value of the part as a share of full scale: the exposure that the doctor proposes.
_BRIGHTEST_SHARE = 0.8
_DRAWS = 4  # random draws of the errors that the calibration states
_STEPS = ("response", "flat_field", "lights")


def remaining_errors(
    calibration: Calibration,
    configured: Lighting,
    shape: tuple[int, int],
    flat_field_error: float = 0.0,
) -> tuple[tuple[str, float], ...]:
    """Mean angular errors in degrees of a simulated part: uncalibrated, then by added part."""
    scale = _LONGER_SIDE_PX / max(shape)
    small = (max(1, round(shape[0] * scale)), max(1, round(shape[1] * scale)))
    part = _Part.of(_scaled(calibration.lighting_of(configured), scale), calibration, small)
    draws = list(_draws(part, flat_field_error))
    applied, lighting = Calibration(), configured
    steps = [("without calibration", _mean_error_deg(draws, applied, lighting))]
    names: list[str] = []
    for name in _STEPS:
        measured = getattr(calibration, name)
        if measured is None or (isinstance(measured, Response) and measured.linear):
            continue
        applied = replace(applied, **{name: measured})
        lighting = part.lighting if name == "lights" else lighting
        names.append(name.replace("_", " "))
        steps.append((f"with {', '.join(names)}", _mean_error_deg(draws, applied, lighting)))
    return tuple(steps)


@dataclass(frozen=True, eq=False)
class _Part:
    """A surface under the true lights, seen by the true camera."""

    slopes: Floats  # (2, H, W) p and q
    lighting: Lighting  # in the small frame
    sheet: Floats  # (N, H, W) light on a white sheet
    calibration: Calibration

    @classmethod
    def of(cls, lighting: Lighting, calibration: Calibration, shape: tuple[int, int]) -> "_Part":
        rows, columns = (np.arange(length) for length in shape)
        p, q = (_SLOPE * np.sin(2.0 * np.pi / _PERIOD_PX * axis) for axis in (columns, rows))
        slopes = np.stack(np.broadcast_arrays(p, q[:, None]))
        field = calibration.flat_field
        if field is None:
            sheet = _ideal_sheet(lighting, calibration, shape)
        else:
            sheet = field.strengths(rows, columns, shape)
        return cls(slopes, lighting, sheet, calibration)

    def error_deg(self, applied: Calibration, lighting: Lighting) -> float:
        """Mean angle between the true normals and those solved with the given parts."""
        images, ambient = (image.astype(np.float32) for image in self._images())
        if applied.response is not None:
            images, ambient = (
                applied.response.linearise(image, 1.0) for image in (images, ambient)
            )
        solved = photometric_stereo(
            images, lighting, "least_squares", ambient=ambient, flat_field=applied.flat_field
        )
        true = np.stack([*-self.slopes, np.ones_like(self.slopes[0])], axis=-1)
        return float(angles_between_deg(true, solved.normals)[solved.valid].mean())

    def _images(self) -> tuple[Floats, Floats]:
        """(N, H, W) light images and (H, W) ambient image as shares of full scale."""
        light = self.sheet * self._shading()
        light *= _BRIGHTEST_SHARE / light.max()
        dark, response = self.calibration.dark, self.calibration.response
        level = 0.0 if dark is None else (dark.offset + (dark.ambient or 0.0)) / dark.full_scale
        ambient = np.full(self.slopes.shape[1:], level)
        if response is None or response.linear:
            return light + ambient, ambient
        levels = np.linspace(0.0, 1.0, len(response.curve))
        if dark is not None:
            ambient = np.asarray(response.linearise(ambient, 1.0), np.float64)
        raw, raw_ambient = (
            np.interp(image, response.curve, levels) for image in (light + ambient, ambient)
        )
        return raw, raw_ambient

    def _shading(self) -> Floats:
        """(N, H, W) light on the part as a multiple of that on a level sheet."""
        (p, q), (height, width) = self.slopes, self.slopes.shape[1:]
        steepness = np.sqrt(1.0 + p * p + q * q)
        if self.lighting.positions_px is None:
            x, y, z = self.lighting.directions.T[..., None, None]
        else:
            x, y, z = self.lighting.positions_px.T[..., None, None]
            x = x - (np.arange(width) - 0.5 * (width - 1))
            y = y - (0.5 * (height - 1) - np.arange(height))[:, None]
        shading: Floats = np.maximum(1.0 - (p * x + q * y) / z, 0.0) / steepness
        return shading


def _mean_error_deg(draws: Sequence[_Part], applied: Calibration, lighting: Lighting) -> float:
    return float(np.mean([part.error_deg(applied, lighting) for part in draws]))


def _scaled(lighting: Lighting, scale: float) -> Lighting:
    if lighting.positions_px is None:
        return lighting
    return Lighting.near(lighting.positions_px * scale)


def _ideal_sheet(lighting: Lighting, calibration: Calibration, shape: tuple[int, int]) -> Floats:
    """(N, H, W) light of equal LEDs on a white sheet."""
    if lighting.positions_px is None:
        return np.broadcast_to(lighting.directions[:, 2, None, None], (len(lighting), *shape))
    x, y = coordinates(np.arange(shape[0]), np.arange(shape[1]), shape)
    grid = [axis.ravel() for axis in np.meshgrid(x, y)]
    lights = calibration.lights
    lobe = 1.0 if lights is None or lights.lobe_exponent is None else lights.lobe_exponent
    positions = lighting.positions_px * (2.0 / max(shape))
    logs = [led_strength(position, lobe, "centre", *grid) for position in positions]
    return np.asarray(np.exp(logs).reshape(-1, *shape), np.float64)


def _draws(part: _Part, flat_field_error: float) -> Iterator[_Part]:
    """Yield the part under true lights, drawn at random from the errors of the calibration."""
    rng = np.random.default_rng(0)
    calibration, count = part.calibration, len(part.lighting)
    lights = calibration.lights
    for _ in range(_DRAWS):
        directions = part.lighting.directions.copy()
        distances = np.ones(count)
        if lights is not None:
            spread = np.radians(lights.direction_errors_deg)[:, None] / np.sqrt(2.0)
            directions += spread * rng.standard_normal((count, 3))
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            if lights.distance_errors is not None:
                distances += lights.distance_errors * rng.standard_normal(count)
        true = Lighting(directions)
        if part.lighting.positions_px is not None:
            lengths = np.linalg.norm(part.lighting.positions_px, axis=1)
            lengths *= np.maximum(distances, 0.1)
            true = Lighting.near(directions * lengths[:, None])
        if calibration.flat_field is None:
            shape = (part.slopes.shape[1], part.slopes.shape[2])
            sheet = _ideal_sheet(true, calibration, shape)
        else:
            factors = 1.0 + flat_field_error * rng.standard_normal(count)
            sheet = part.sheet * factors[:, None, None]
        yield replace(part, lighting=true, sheet=sheet)
