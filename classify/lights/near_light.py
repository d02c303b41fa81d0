"""Near lights: their strength and direction at each pixel of the part.

A light at P, at the distance R = |P| from the middle of the frame, lights the surface at X with
rho n . (P - X) / |P - X|^3. Divided by the strength over a level sheet, `sheet_of`, the image is

    i_k = b . (l_k - X / R_k),    b = rho n,    l_k = P_k / R_k.

Let c be the vector with c . l_k = 1 / R_k for all lights, which exists for three lights, and for
more if they lie in one plane, c . P = 1. Then

    i_k = l_k . b',    b' = b - (b . X) c,

so that a solver of distant lights, whichever lights it uses, finds b'. Its inner product with X is
b' . X = (b . X) (1 - c . X), and therefore

    b = b' + c (b' . X) / (1 - c . X).

For lights out of one plane c is that of least squares, and e_k = c . l_k - 1 / R_k, the excess,
remains: i_k = l_k . b' + e_k (b . X). The solvers subtract it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from classify.base.arrays import FloatMap, Floats
from classify.lighting import Lighting

from .flat_field import TERMS, FlatField, powers

# Margin of bounds that come from a grid of points: between neighbours the logarithm of a strength
# differs by less.
_MARGIN = 0.05


@dataclass(frozen=True, eq=False)
class Shear:
    """The difference of near lights from distant ones in the same directions; 0 if distant."""

    plane: FloatMap  # (3,) c of the plane of the lights, per px
    excess: FloatMap  # (N,) e of each light, per px
    inverse_distances: FloatMap  # (N,) 1 / R of each light, per px

    @classmethod
    def of(cls, lighting: Lighting) -> Shear:
        inverse = np.zeros(len(lighting))
        if lighting.positions_px is not None:
            inverse = 1.0 / np.linalg.norm(lighting.positions_px, axis=1)
        plane = np.linalg.pinv(lighting.directions) @ inverse
        excess = lighting.directions @ plane - inverse
        return cls(*(values.astype(np.float32) for values in (plane, excess, inverse)))


def coordinates_px(shape: tuple[int, int]) -> tuple[FloatMap, FloatMap]:
    """(W,) x of the columns and (H,) y of the rows of a frame, from its middle, px."""
    rows, columns = ((np.arange(side) - 0.5 * (side - 1)).astype(np.float32) for side in shape)
    return columns, -rows


def sheet_of(
    lighting: Lighting, shape: tuple[int, int], lobe_exponent: float | None = None
) -> FlatField:
    """The white matt sheet under near lights.

    Its light follows the inverse square of the distance, Lambert's law, and a lobe cos^m to the
    middle, where the geometric mean of the lights is 1.
    """
    positions, half = lighting.positions_px, 0.5 * max(shape)
    assert positions is not None
    # In the coordinates of a flat field, through the values at the zeros of a Chebyshev polynomial,
    # which is within a few percent of the best approximation.
    nodes = np.cos(np.pi * (np.arange(TERMS) + 0.5) / TERMS)
    height, width = (side / max(shape) for side in shape)
    middle_strengths = lighting.intensities * lighting.directions[:, 2]
    middle_strengths /= np.exp(np.log(middle_strengths).mean())

    def logarithms(x: Floats) -> Floats:
        plane = np.zeros((3, len(x), len(x)))
        plane[0], plane[1] = half * width * x, half * height * x[:, None]
        towards = positions[:, :, None, None] - plane
        distances = np.linalg.norm(positions, axis=1)[:, None, None]
        ratios = np.linalg.norm(towards, axis=1) / distances
        cosines = np.einsum("kc,kcij->kij", lighting.directions, towards) / (distances * ratios)
        # The logarithm stays finite where a pixel is behind an LED and gets no light.
        lobes = np.maximum(cosines, 1e-3) ** (lobe_exponent or 0.0)
        strengths = middle_strengths[:, None, None] / ratios**3 * lobes
        return np.asarray(np.log(strengths), np.float64)

    inverse = np.linalg.inv(powers(nodes, TERMS))
    coefficients = inverse @ logarithms(nodes) @ inverse.T
    coefficients /= np.outer(height ** np.arange(TERMS), width ** np.arange(TERMS))
    grid = logarithms(np.linspace(-1.0, 1.0, 4 * TERMS))
    bounds = np.stack([grid.min(axis=(1, 2)) - _MARGIN, grid.max(axis=(1, 2)) + _MARGIN], axis=1)
    return FlatField(coefficients, bounds)
