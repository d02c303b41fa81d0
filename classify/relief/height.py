"""Relative height from a gradient field, and relief above the surroundings."""

import cv2
import numpy as np
import scipy

from classify.base.arrays import BoolArray, FloatMap
from classify.base.errors import InputError
from classify.base.threads import thread_count

# Iterations end when the error has this share of its first value. Masks took up to 16.
_TOLERANCE, _MAX_ITERATIONS = 1e-4, 50


def integrate_gradients(p: FloatMap, q: FloatMap, valid: BoolArray | None = None) -> FloatMap:
    """Relative height of zero mean with the least squared gradient error.

    Slopes at half pixels are means of neighbouring p (q). The height whose differences are nearest
    to them solves Poisson's equation with free boundaries, which the cosine transform does exactly
    and in one step (Simchony, Chellappa and Shao 1990). It does not assume a periodic frame, as
    the Fourier transform of Frankot and Chellappa (1988) does: on a frame that is not periodic its
    error is a quarter of the height (tests/classify/relief/test_height.py). Pixels that are not
    valid get the mean slope of valid neighbours. Differences to those that have none have no
    weight: the transform then preconditions conjugate gradients, which bridge them smoothly.

    Parameters
    ----------
    p, q
        (H, W) float32 dz/dx and dz/dy, y up, finite.
    valid
        (H, W) bool; pixels with a known slope, by default all.

    Returns
    -------
    (H, W) float32, pixels. Constant slopes are kept; the mean height is not determined, nor are the
    levels of areas that are not connected.

    Raises
    ------
    InputError
        If the shapes differ or a gradient is not finite.
    """
    if p.shape != q.shape or p.ndim != 2 or p.size == 0:
        raise InputError(f"p is {p.shape} and q {q.shape}; both must be (rows, columns)")
    if valid is not None and valid.shape != p.shape:
        raise InputError(f"valid is {valid.shape} and p {p.shape}; both must be (rows, columns)")
    if not (np.isfinite(p).all() and np.isfinite(q).all()):
        raise InputError("the gradients contain NaN or infinity; set such pixels to 0 first")
    known = np.ones(p.shape, np.bool_) if valid is None else valid
    if not known.all():
        # Without these means, scattered pixels that are not valid take ten times the iterations.
        count = _neighbour_sums(known.astype(np.float32))
        p, q = (
            np.where(known, plane, _neighbour_sums(plane * known) / np.maximum(count, 1.0))
            for plane in (p, q)
        )
        known = count > 0.0
    along_x = 0.5 * (p[:, 1:] + p[:, :-1])
    # Rows run down and y runs up, hence the sign of q.
    along_rows = -0.5 * (q[1:, :] + q[:-1, :])
    if known.all():
        return _poisson(_divergence(along_x, along_rows))
    known_x, known_rows = known[:, 1:] & known[:, :-1], known[1:, :] & known[:-1, :]
    residual = _divergence(along_x * known_x, along_rows * known_rows)
    height = np.zeros_like(residual)
    direction = solved = _poisson(residual)
    error = _product(residual, solved)
    smallest = _TOLERANCE**2 * error
    for _ in range(_MAX_ITERATIONS):
        if error <= smallest:
            break
        change = _divergence(
            np.diff(direction, axis=1) * known_x, np.diff(direction, axis=0) * known_rows
        )
        step = np.float32(error / _product(direction, change))
        height += step * direction
        residual -= step * change
        solved = _poisson(residual)
        previous, error = error, _product(residual, solved)
        direction = solved + np.float32(error / previous) * direction
    return height


def _neighbour_sums(plane: FloatMap) -> FloatMap:
    """Sums over 3 x 3 pixels, without those beyond the frame."""
    return np.asarray(
        cv2.boxFilter(plane, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
    )


def _product(one: FloatMap, other: FloatMap) -> float:
    """Inner product without its sign, which is negative: `_divergence` is of differences."""
    return abs(float(np.multiply(one, other).sum(dtype=np.float64)))


def _divergence(along_x: FloatMap, along_rows: FloatMap) -> FloatMap:
    """(H, W) divergence of differences to the next column and the next row."""
    divergence = np.zeros((along_x.shape[0], along_rows.shape[1]), np.float32)
    divergence[:, :-1] += along_x
    divergence[:, 1:] -= along_x
    divergence[:-1, :] += along_rows
    divergence[1:, :] -= along_rows
    return divergence


def _poisson(divergence: FloatMap) -> FloatMap:
    """Height of zero mean with this divergence of its differences, with free boundaries."""
    rows, columns = divergence.shape
    spectrum = scipy.fft.dctn(divergence, type=2, norm="ortho", workers=thread_count())
    eigenvalues = _second_difference_eigenvalues(rows)[:, None] + _second_difference_eigenvalues(
        columns
    )
    eigenvalues[0, 0] = 1.0
    spectrum /= eigenvalues
    spectrum[0, 0] = 0.0
    height: FloatMap = scipy.fft.idctn(spectrum, type=2, norm="ortho", workers=thread_count())
    return height


def _second_difference_eigenvalues(length: int) -> FloatMap:
    """Eigenvalues 2 cos(pi k / length) - 2 of the second difference, exact in float32."""
    sine = np.sin(0.5 * np.pi * np.arange(length) / length)
    return (-4.0 * sine * sine).astype(np.float32)


# With this the Gaussian of ISO 16610 passes one half at the cut-off wavelength.
_ALPHA = np.sqrt(np.log(2.0) / np.pi)
# Longer waves of an integrated height are mostly drift (test_local_height.py).
_CUTOFFS_PER_SIDE = 5.0


def default_cutoff_px(shape: tuple[int, int]) -> float:
    """Default cut-off wavelength: a fifth of the frame's longer side."""
    return max(shape) / _CUTOFFS_PER_SIDE


def local_relief(
    height: FloatMap, valid: BoolArray | None = None, *, cutoff_px: float | None = None
) -> FloatMap:
    """Relative height above the Gaussian mean of the surroundings.

    It is positive where the part is raised, and negative where it is indented.

    The L-filter of ISO 25178-2, a Gaussian after ISO 16610-61 with transmission
    exp(-pi (alpha cutoff f)^2), alpha^2 = ln 2 / pi, removes the form of the part and
    the drift that integrated gradients have over long distances. Waves much shorter than the
    cut-off are kept, a wave of the cut-off's length is halved.

    Parameters
    ----------
    height
        (H, W) float32, as from `integrate_gradients`, px.
    valid
        (H, W) bool; the relief is 0 where false.
    cutoff_px
        Wavelength of the filter, by default a fifth of the longer side of the frame. A round bump
        whose width at half height is a quarter of it keeps three quarters of its height; of a much
        wider bump only the edges remain.

    Returns
    -------
    (H, W) float32, px.

    Raises
    ------
    InputError
        If the height is not a finite (rows, columns) array, or the cut-off is not positive.

    Notes
    -----
    The filter works in the cosine basis, as if the frame were mirrored at its borders: the basis in
    which `integrate_gradients` solves.
    """
    if height.ndim != 2 or height.size == 0:
        raise InputError(f"the height is {height.shape}; it must be (rows, columns)")
    if not np.isfinite(height).all():
        raise InputError("the height contains NaN or infinity")
    rows, columns = height.shape
    cutoff = default_cutoff_px((rows, columns)) if cutoff_px is None else cutoff_px
    if not 0.0 < cutoff < np.inf:
        raise InputError(f"cutoff_px is {cutoff_px}; it must be a positive wavelength in pixels")
    spectrum = scipy.fft.dctn(height, type=2, norm="ortho", workers=thread_count())
    # The filter of the relief is 1 minus a mean; the mean is separable, so it is subtracted.
    mean = spectrum * _transmission(rows, cutoff)[:, None]
    mean *= _transmission(columns, cutoff)
    spectrum -= mean
    relief: FloatMap = scipy.fft.idctn(spectrum, type=2, norm="ortho", workers=thread_count())
    if valid is not None:
        relief *= valid
    return relief


def _transmission(length: int, cutoff_px: float) -> FloatMap:
    """Transmission of the cosines of one axis, k / (2 length) cycles per pixel each."""
    frequencies_cpp = np.arange(length) / (2.0 * length)
    transmission: FloatMap = np.exp(-np.pi * (_ALPHA * cutoff_px * frequencies_cpp) ** 2).astype(
        np.float32
    )
    return transmission
