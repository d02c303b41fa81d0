"""Light directions, and the conventions for axes, tilt, slant and their signs.

x points right, y up (against the row index), z towards the camera. Tilt is anticlockwise from +x,
slant from the z axis. Gradients are p = dz/dx and q = dz/dy; as rows grow downwards, q = -dz/drow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Floats

from .base.errors import InputError

RING_TILTS_DEG = (0.0, 90.0, 180.0, 270.0)


def light_vectors(tilts_deg: npt.ArrayLike, slants_deg: npt.ArrayLike) -> Floats:
    """Unit vectors towards the lights, (N, 3): (cos t sin s, sin t sin s, cos s)."""
    tilt, slant = np.broadcast_arrays(np.radians(tilts_deg), np.radians(slants_deg))
    vectors = (np.cos(tilt) * np.sin(slant), np.sin(tilt) * np.sin(slant), np.cos(slant))
    return np.stack(vectors, axis=-1).astype(np.float64)


# Range of the distance of a near light, px. Below it the light is within one pixel; beyond it the
# direction changes by less than 1e-5 over a frame of 10,000 px, as of a distant light.
_NEAREST_PX, _FARTHEST_PX = 1.0, 1e9


@dataclass(frozen=True, eq=False)
class Lighting:
    """N lights: unit vectors towards them, relative intensities, and positions.

    Parameters
    ----------
    directions
        (N, 3) vectors towards the lights, normalised here. All must be above the surface (z > 0).
        Those of near lights are seen from the middle of the frame.
    intensities
        (N,) relative intensities; an image is divided by its light's intensity. All are 1 if none
        are given; ps4_robust then estimates them from the images. Those of near lights are the
        intensities at the middle of the frame.
    positions_px
        (N, 3) positions of near lights in pixels of the image at the part, relative to the middle
        of the frame; None for distant lights. `near` takes the directions from them.

    Attributes
    ----------
    intensities_given
        Whether the intensities were given, also where all are 1; ps4_robust does not change them.

    Raises
    ------
    InputError
        For another shape, a zero or non-finite vector, a light at or below the horizon, an
        intensity that is not positive, or a position that is nearer than 1 px, farther than 1e9 px
        or not in the direction of its light.
    """

    directions: Floats
    intensities: Floats = field(default_factory=lambda: np.empty(0))
    intensities_given: bool = field(init=False)
    positions_px: Floats | None = None

    def __post_init__(self) -> None:
        directions = _numbers(self.directions, "light directions")
        if directions.ndim != 2 or directions.shape[1] != 3 or len(directions) == 0:
            raise InputError(
                f"light directions have shape {directions.shape}; give one (x, y, z) row per light"
            )
        intensities = _numbers(self.intensities, "light intensities")
        object.__setattr__(self, "intensities_given", intensities.size > 0)
        if not self.intensities_given:
            intensities = np.ones(len(directions))
        if intensities.shape != (len(directions),):
            raise InputError(
                f"{intensities.size} light intensities for {len(directions)} lights; give one each"
            )
        for light, direction in enumerate(directions.tolist()):
            if fault := light_fault(direction, intensities[light]):
                raise InputError(f"light {light} {fault}")
        # Adding 0.0 turns -0.0 into 0.0, so that equal lights have equal bytes and hashes.
        directions = directions / np.linalg.norm(directions, axis=1)[:, None] + 0.0
        if self.positions_px is not None:
            positions, directions = _positions(self.positions_px, directions)
            object.__setattr__(self, "positions_px", positions)
        directions.flags.writeable = False
        intensities.flags.writeable = False
        object.__setattr__(self, "directions", directions)
        object.__setattr__(self, "intensities", intensities)

    @classmethod
    def ring(cls, slant_deg: float = 45.0, tilts_deg: Sequence[float] = RING_TILTS_DEG) -> Lighting:
        """Lights at one slant, by default the four of PS4 at tilts 0, 90, 180 and 270.

        Examples
        --------
        >>> Lighting.ring(slant_deg=45.0).tilts_deg.tolist()
        [0.0, 90.0, 180.0, 270.0]
        """
        return cls.from_angles(tilts_deg, slant_deg)

    @classmethod
    def near(
        cls, positions_px: npt.ArrayLike, intensities: npt.ArrayLike | None = None
    ) -> Lighting:
        """Lights at (N, 3) positions in pixels, relative to the middle of the frame.

        Examples
        --------
        >>> lighting = Lighting.near([[300, 0, 400], [0, 300, 400], [-300, 0, 400]])
        >>> lighting.directions[0].tolist()
        [0.6, 0.0, 0.8]
        """
        positions = _numbers(positions_px, "light positions")
        levels = np.empty(0) if intensities is None else _numbers(intensities, "light intensities")
        return cls(positions, levels, positions)

    @classmethod
    def from_angles(
        cls, tilts_deg: Sequence[float], slants_deg: float | Sequence[float]
    ) -> Lighting:
        """Lights at the given tilts and slants, in degrees; slants from 0 to below 89.9."""
        tilts, slants = _numbers(tilts_deg, "tilts"), _numbers(slants_deg, "slants")
        if not (np.abs(tilts) <= 3600.0).all():
            raise InputError(f"tilts {tilts_deg!r} are not all numbers of degrees, -3600 to 3600")
        if slants.size not in (1, len(tilts)):
            raise InputError(
                f"{slants.size} slants for {len(tilts)} tilts; give one for all or one each"
            )
        if not ((slants >= 0) & (slants < 89.9)).all():
            raise InputError(f"slant {slants_deg} is outside 0 to 89.9 degrees from the z axis")
        return cls(light_vectors(tilts, slants))

    def __len__(self) -> int:
        return len(self.directions)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Lighting) and self._bytes == other._bytes

    def __hash__(self) -> int:
        return hash(self._bytes)

    @property
    def _bytes(self) -> tuple[bytes, ...]:
        arrays = self.directions, self.intensities, self.positions_px
        return tuple(b"" if array is None else array.tobytes() for array in arrays)

    @property
    def tilts_deg(self) -> Floats:
        """(N,) tilts in degrees, [0, 360), rounded to a billionth of a degree."""
        x, y = self.directions[:, 0], self.directions[:, 1]
        return _rounded(np.degrees(np.arctan2(y, x))) % 360.0

    @property
    def slants_deg(self) -> Floats:
        """(N,) slants in degrees from the z axis, rounded to a billionth of a degree."""
        across = np.hypot(self.directions[:, 0], self.directions[:, 1])
        return _rounded(np.degrees(np.arctan2(across, self.directions[:, 2])))

    def within(self, degrees: float, other: Lighting) -> bool:
        """Whether `other` has as many lights, each within `degrees` of its counterpart.

        Near lights are compared as seen from the middle of the frame.
        """
        if len(self) != len(other):
            return False
        return bool(angles_between_deg(self.directions, other.directions).max() <= degrees)

    def light_nearest_tilt(self, tilt_deg: float, within_deg: float = 30.0) -> int:
        """Index of the light whose tilt is nearest to `tilt_deg`.

        Raises
        ------
        InputError
            If no light is within `within_deg` of it.
        """
        differences_deg = np.abs((self.tilts_deg - tilt_deg + 180.0) % 360.0 - 180.0)
        nearest = int(np.argmin(differences_deg))
        if differences_deg[nearest] > within_deg:
            raise InputError(
                f"no light stands near tilt {tilt_deg:g}; the tilts are "
                + ", ".join(f"{tilt:g}" for tilt in self.tilts_deg)
            )
        return nearest


def light_fault(direction: Sequence[float], intensity: float = 1.0) -> str | None:
    """Describe what is wrong with the direction or intensity of a light; None if nothing is."""
    # Squares of larger numbers would overflow.
    if not all(abs(component) <= 1e9 for component in direction) or max(map(abs, direction)) < 1e-9:
        return (
            f"has a direction that is zero or not finite, or beyond 1e9: {[*direction]}; give "
            "(x, y, z) towards it"
        )
    if direction[2] / math.hypot(*direction) <= 1e-3:
        return (
            f"stands at or below the horizon (direction {[*direction]}); directions point from the "
            "surface to the light, z towards the camera"
        )
    # Far beyond what one exposure can show; float32 holds the gains and their squares.
    if not 1e-6 <= intensity <= 1e6:
        return f"has the intensity {intensity:g}; give a positive number, 1e-6 to 1e6"
    return None


def orientation_near(orientation_deg: float, near_deg: float) -> float:
    """Return the same orientation, modulo 180, at most 90 degrees from `near_deg`."""
    return near_deg + (orientation_deg - near_deg + 90.0) % 180.0 - 90.0


def orientation_text(orientation_deg: float, digits: int, period_deg: float = 180.0) -> str:
    """Format an orientation with `digits` decimals: 179.98 becomes 0.0, not 180.0."""
    return f"{round(orientation_deg, digits) % period_deg:.{digits}f}"


def _numbers(values: npt.ArrayLike, name: str) -> Floats:
    """Copy numbers as float64; `name` is for the message."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} {values!r} are not all numbers") from error


def _positions(positions_px: npt.ArrayLike, directions: Floats) -> tuple[Floats, Floats]:
    """Checked positions, and the exact directions towards them."""
    positions = _numbers(positions_px, "light positions") + 0.0
    if positions.shape != directions.shape:
        raise InputError(
            f"light positions have shape {positions.shape} for {len(directions)} lights; give one "
            "(x, y, z) row in px per light"
        )
    distances = np.linalg.norm(positions, axis=1)
    if not ((distances >= _NEAREST_PX) & (distances <= _FARTHEST_PX)).all():
        raise InputError(
            f"a light stands {distances.min():g} to {distances.max():g} px from the middle of the "
            f"frame; near lights stand {_NEAREST_PX:g} to {_FARTHEST_PX:g} px away"
        )
    exact = positions / distances[:, None]
    if np.abs(exact - directions).max() > 1e-6:
        raise InputError(
            "light directions and positions disagree; give the positions only (Lighting.near)"
        )
    positions.flags.writeable = False
    return positions, exact


def _rounded(degrees: Floats) -> Floats:
    # Directions are exact to 1e-16; without rounding, 90 degrees would be 90.00000000000001.
    return np.asarray(np.round(degrees, 9), dtype=np.float64)


def angles_between_deg(vectors: npt.ArrayLike, others: npt.ArrayLike) -> Floats:
    """Angles in degrees between (..., 3) vectors of any length and their counterparts."""
    a, b = np.asarray(vectors, np.float64), np.asarray(others, np.float64)
    # atan2 keeps small angles, which the cosine loses.
    across = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.degrees(np.arctan2(across, (a * b).sum(axis=-1))), np.float64)
