"""Relative height from a gradient field."""

import numpy as np
import scipy.fft

from classify.base.arrays import FloatMap
from classify.base.errors import InputError
from classify.base.threads import thread_count


def integrate_gradients(p: FloatMap, q: FloatMap) -> FloatMap:
    """Relative height of zero mean with the least squared gradient error.

    Slopes at half pixels are means of neighbouring p (q). The height whose differences are nearest
    to them solves Poisson's equation with free boundaries, which the cosine transform does exactly
    and in one step (Simchony, Chellappa and Shao 1990). It does not assume a periodic frame, as
    the Fourier transform of Frankot and Chellappa (1988) does: on a frame that is not periodic its
    error is a quarter of the height (tests/classify/relief/test_height.py).

    Parameters
    ----------
    p, q
        (H, W) float32 dz/dx and dz/dy, y up, finite.

    Returns
    -------
    (H, W) float32, pixels. Constant slopes are kept; the mean height is not determined.

    Raises
    ------
    InputError
        If the shapes differ or a gradient is not finite.
    """
    if p.shape != q.shape or p.ndim != 2 or p.size == 0:
        raise InputError(f"p is {p.shape} and q {q.shape}; both must be (rows, columns)")
    if not (np.isfinite(p).all() and np.isfinite(q).all()):
        raise InputError("the gradients contain NaN or infinity; set such pixels to 0 first")
    rows, columns = p.shape
    divergence = np.zeros((rows, columns), dtype=np.float32)
    along_x = 0.5 * (p[:, 1:] + p[:, :-1])
    divergence[:, :-1] += along_x
    divergence[:, 1:] -= along_x
    # Rows run down and y runs up, hence the sign of q.
    along_rows = -0.5 * (q[1:, :] + q[:-1, :])
    divergence[:-1, :] += along_rows
    divergence[1:, :] -= along_rows

    spectrum = scipy.fft.dctn(divergence, type=2, norm="ortho", workers=thread_count())
    eigenvalues = _second_difference(rows)[:, None] + _second_difference(columns)
    eigenvalues[0, 0] = 1.0
    spectrum /= eigenvalues
    spectrum[0, 0] = 0.0
    height: FloatMap = scipy.fft.idctn(spectrum, type=2, norm="ortho", workers=thread_count())
    return height


def _second_difference(length: int) -> FloatMap:
    """Eigenvalues of the second difference with free ends, 2 cos(pi k / length) - 2.

    As the square of a sine: a float32 cosine near 1 has too few digits for the lowest frequencies.
    """
    sine = np.sin(0.5 * np.pi * np.arange(length) / length)
    return (-4.0 * sine * sine).astype(np.float32)
