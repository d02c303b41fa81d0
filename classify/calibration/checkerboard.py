"""Scale of the image and distortion of the lens, from pictures of a checkerboard."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy import optimize

from classify.base.arrays import Array, Floats
from classify.base.errors import CalibrationRejected, InputError

from .correction import Scale, nominal_camera_matrix

# Inner corners along a side: fewer show no distortion, OpenCV needs three.
_CORNERS = (3, 64)
# A placement tilted by less counts as lying in the plane of the part; its scale is measured along
# the axis of the tilt, which a tilt does not shorten. At a larger tilt the height of the board is
# too uncertain: one end of 50 mm rises by 9 mm.
_FLAT_DEG = 10.0
# Tilts below this are not corrected: one picture shows a tilt to about 3 degrees, and 3 degrees
# shorten a length by 0.1 %.
SEEN_TILT_DEG = 5.0
# Corners are found to 0.02 to 0.2 px on sharp pictures. A model with a larger residual than this is
# wrong.
_WORST_RESIDUAL_PX = 1.0
# Distortion that moves no pixel by more is not worth the resampling.
_LEAST_DISTORTION_PX = 0.5
# A further coefficient counts if it explains this many times its share of the residual (F test with
# more than 50 degrees of freedom: 1 in 1000).
_SIGNIFICANT = 11.0
# Distortion counts if it moves a corner of the board by this many times the residual: errors of
# corners in a small picture of the board grow into pixels at the corners of the frame.
_VISIBLE_DISTORTION = 3.0
# The focal length is kept if its standard error is at most this: spheres then have their view
# directions to 5 % of the angle.
_KNOWN_FOCAL = 0.05
# Error of a scale that is fitted together with distortion (test_checkerboard.py has up to 0.04 %).
_WITH_DISTORTION = 0.0003
# Least number of tilted placements that determine the focal length (Zhang 2000).
_TILTED_FOR_FOCAL = 2


@dataclass(frozen=True, eq=False)
class CheckerboardScale:
    """The scale from a checkerboard."""

    scale: Scale
    tilts_deg: Floats  # (J,) of each placement from the image plane, known to about 3 degrees
    distortion_px: float  # the most by which distortion moves a pixel of the frame
    covered: float  # share of the diagonal that the corners reach from the middle


def find_corners(image: Array, corners: tuple[int, int]) -> Floats:
    """(n, 2) columns and rows of the inner corners of a checkerboard in an (H, W) picture."""
    if not all(_CORNERS[0] <= count <= _CORNERS[1] for count in corners):
        raise InputError(
            f"a checkerboard with {corners[0]} x {corners[1]} inner corners; {_CORNERS[0]} to "
            f"{_CORNERS[1]} each are handled"
        )
    values = image.astype(np.float32)
    low, high = (float(level) for level in np.quantile(values[::2, ::2], (0.01, 0.99)))
    eight = np.clip((values - low) * (255.0 / max(high - low, 1e-9)), 0, 255).astype(np.uint8)
    detected = _corners(eight, corners)
    if detected is not None:
        return detected
    fewer = corners[0] - 1, corners[1] - 1
    if min(fewer) >= _CORNERS[0] and _corners(eight, fewer) is not None:
        raise CalibrationRejected(
            f"the board has {fewer[0]} x {fewer[1]} inner corners, not {corners[0]} x "
            f"{corners[1]}; count corners where four squares meet, not squares"
        )
    raise CalibrationRejected(
        f"no checkerboard with {corners[0]} x {corners[1]} inner corners is seen; show the whole "
        "board with a white border, sharp, and without reflections"
    )


def _corners(image: npt.NDArray[np.uint8], corners: tuple[int, int]) -> Floats | None:
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    is_found, at = cv2.findChessboardCornersSB(image, corners, flags=flags)
    if not is_found:
        return None
    # The gradients around a corner place it to 0.02 px where the search does to 0.2 px
    # (test_checkerboard.py). The window stays within the four squares.
    grid = at.reshape(corners[1], corners[0], 2)
    spacing = min(float(np.linalg.norm(np.diff(grid, axis=k), axis=2).min()) for k in (0, 1))
    half = int(np.clip(0.3 * spacing, 2, 15))
    ends = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    fine = cv2.cornerSubPix(image, at.astype(np.float32), (half, half), (-1, -1), ends)
    return np.asarray(fine, np.float64).reshape(-1, 2)


def scale_of_boards(
    boards: Sequence[Floats],
    corners: tuple[int, int],
    square_mm: float,
    frame: tuple[int, int],
) -> CheckerboardScale:
    """Fit scale and radial distortion to (n, 2) corners of one board's placements (Zhang 2000)."""
    if not 0.0 < square_mm < np.inf:
        raise InputError(f"squares of {square_mm:g} mm; give their side, a positive number")
    across, along = np.meshgrid(np.arange(corners[0]), np.arange(corners[1]))
    board = square_mm * np.stack([across.ravel(), along.ravel()], axis=1).astype(np.float64)
    board -= board.mean(axis=0)
    camera = nominal_camera_matrix(frame)
    middle = np.array([camera[0, 2], camera[1, 2]])
    fit = _fitted(boards, board, camera, 0)
    focal_error = None
    tilted = np.count_nonzero(_tilts_deg(fit, middle) > _FLAT_DEG)
    measured = _focal_length(boards, board, frame) if tilted >= _TILTED_FOR_FOCAL else None
    if measured is not None:
        camera[0, 0] = camera[1, 1] = measured[0]
        focal_error = measured[1]
    for radial in (1, 2):
        better = _fitted(boards, board, camera, radial)
        moved = np.concatenate(
            [_distorted(points, better.radial, camera) - points for points in boards]
        )
        is_visible = np.abs(moved).max() > _VISIBLE_DISTORTION * better.residual_px
        if is_visible and fit.cost - better.cost > _SIGNIFICANT * better.cost / better.freedom:
            fit = better
    if fit.residual_px > _WORST_RESIDUAL_PX:
        raise CalibrationRejected(
            f"the corners are {fit.residual_px:.1f} px off a flat board; count its inner corners "
            "again, glue it to something flat, and keep it still for each picture"
        )
    distortion_px = _largest_shift_px(fit.radial, camera, frame)
    tilts_deg = _tilts_deg(fit, middle)
    flat = tilts_deg <= _FLAT_DEG
    if not flat.any():
        raise CalibrationRejected(
            f"the board is tilted by {tilts_deg.min():.0f} degrees; lay it flat where the part "
            "will be"
        )
    stretches = np.array([_stretch(homography, middle) for homography in fit.homographies])
    largest, smallest = stretches[flat].T
    # The axis of a tilt keeps its length. Below, the difference is within the error of corners.
    is_tilted = tilts_deg[flat] > SEEN_TILT_DEG
    lengths = np.where(is_tilted, largest, np.sqrt(largest * smallest))
    px_per_mm = float(lengths.mean())
    # Relative errors: of the corners, of the correction of tilts, and between placements.
    extent_px = px_per_mm * float(np.sqrt((board**2).sum(axis=1).mean()))
    noise = fit.residual_px / np.sqrt(len(board)) / extent_px
    shortened = 0.5 * (1.0 - float((smallest / largest).min()))
    spread = float(lengths.std()) / px_per_mm
    with_distortion = _WITH_DISTORTION if fit.radial.any() else 0.0
    is_bent = distortion_px > _LEAST_DISTORTION_PX
    reach = max(float(np.linalg.norm(points - middle, axis=1).max()) for points in boards)
    scale = Scale(
        mm_per_px=1.0 / px_per_mm,
        error=float(np.sqrt(noise**2 + shortened**2 + spread**2 + with_distortion**2)),
        camera_matrix=camera,
        distortion=np.array([*fit.radial, 0.0, 0.0, 0.0]) if is_bent else None,
        residual_px=fit.residual_px,
        focal_error=focal_error,
    )
    return CheckerboardScale(scale, tilts_deg, distortion_px, reach / float(np.linalg.norm(middle)))


@dataclass(frozen=True, eq=False)
class _Fit:
    homographies: Floats  # (J, 3, 3), from mm on the board to pixels without distortion
    radial: Floats  # (2,) k1 and k2
    cost: float  # sum of squared residuals in px
    freedom: int
    residual_px: float


def _fitted(boards: Sequence[Floats], board: Floats, camera: Floats, radial: int) -> _Fit:
    """Fit a homography to each placement, and `radial` distortion coefficients to all."""
    starts = [cv2.findHomography(board, points)[0] for points in boards]
    if any(homography is None for homography in starts):
        raise CalibrationRejected("the corners do not form a board; take the picture again")
    start = np.concatenate(
        [np.zeros(radial), *(homography.ravel()[:8] / homography[2, 2] for homography in starts)]
    )

    def parts(values: Floats) -> tuple[Floats, Floats]:
        bent = np.zeros(2)
        bent[:radial] = values[:radial]
        rows = values[radial:].reshape(-1, 8)
        return bent, np.concatenate([rows, np.ones((len(rows), 1))], axis=1).reshape(-1, 3, 3)

    def residuals(values: Floats) -> Floats:
        bent, homographies = parts(values)
        off = [
            _distorted(_mapped(homography, board), bent, camera) - points
            for homography, points in zip(homographies, boards, strict=True)
        ]
        return np.concatenate(off).ravel()

    scales = np.concatenate(
        [np.ones(radial), np.tile([1, 1, 100, 1, 1, 100, 1e-3, 1e-3], len(boards))]
    )
    solution = optimize.least_squares(residuals, start, x_scale=scales)
    bent, homographies = parts(solution.x)
    cost, freedom = 2.0 * float(solution.cost), solution.fun.size - start.size
    residual_px = float(np.sqrt(2.0 * cost / solution.fun.size))
    return _Fit(homographies, bent, cost, freedom, residual_px)


def _mapped(homography: Floats, points: Floats) -> Floats:
    x, y, w = (points @ homography[:, :2].T + homography[:, 2]).T
    return np.stack([x / w, y / w], axis=1)


def _distorted(points: Floats, radial: Floats, camera: Floats) -> Floats:
    """Pixels (n, 2) where a lens with k1 and k2 of OpenCV's model shows these pixels."""
    middle = np.array([camera[0, 2], camera[1, 2]])
    squared = (((points - middle) / camera[0, 0]) ** 2).sum(axis=1)
    gain = 1.0 + squared * (radial[0] + squared * radial[1])
    return np.asarray(middle + (points - middle) * gain[:, None])


def _largest_shift_px(radial: Floats, camera: Floats, frame: tuple[int, int]) -> float:
    corner = np.array([float(frame[1] - 1), float(frame[0] - 1)])
    middle = np.array([camera[0, 2], camera[1, 2]])
    points = middle + np.linspace(0.0, 1.0, 65)[:, None] * (corner - middle)
    shift = np.linalg.norm(_distorted(points, radial, camera) - points, axis=1)
    return float(shift.max())


def _tilts_deg(fit: _Fit, middle: Floats) -> Floats:
    """Tilt of each placement, by how much it is shortened across the axis of the tilt."""
    stretches = np.array([_stretch(homography, middle) for homography in fit.homographies])
    return np.asarray(np.degrees(np.arccos(np.clip(stretches[:, 1] / stretches[:, 0], 0.0, 1.0))))


def _stretch(homography: Floats, at_px: Floats) -> Floats:
    """Largest and smallest px per mm of the board in the middle of the frame."""
    place = np.linalg.solve(homography, [*at_px, 1.0])
    x, y = place[:2] / place[2]
    w = homography[2] @ [x, y, 1.0]
    jacobian = (homography[:2, :2] - np.outer(at_px, homography[2, :2])) / w
    return np.asarray(np.linalg.svd(jacobian, compute_uv=False))


def _focal_length(
    boards: Sequence[Floats], board: Floats, frame: tuple[int, int]
) -> tuple[float, float] | None:
    """Focal length in px and its relative standard error; None if not determined."""
    objects = [np.column_stack([board, np.zeros(len(board))]).astype(np.float32)] * len(boards)
    images = [points.astype(np.float32)[:, None] for points in boards]
    flags = (
        cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_K3 | cv2.CALIB_USE_INTRINSIC_GUESS
    )  # fmt: skip
    try:
        camera = cv2.calibrateCameraExtended(
            objects, images, frame[::-1], nominal_camera_matrix(frame), np.zeros(5), flags=flags
        )
    except cv2.error:
        return None
    focal_px, deviation = float(camera[1][0, 0]), float(np.ravel(camera[5])[0])
    # With equal aspect the deviation of one of the two may be given as 0.
    deviation = max(deviation, float(np.ravel(camera[5])[1]))
    if not (0.0 < focal_px < 100.0 * max(frame) and 0.0 < deviation <= _KNOWN_FOCAL * focal_px):
        return None
    return focal_px, deviation / focal_px
