"""Scale of the image and distortion of the lens, from pictures of a checkerboard."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, Floats
from classify.base.errors import CalibrationRejected, InputError

from .calibration import Scale, nominal_camera_matrix

# Smallest and largest number of inner corners along a side. OpenCV needs three.
_CORNER_COUNTS = (3, 64)
# Largest tilt of a placement that counts as lying in the plane of the part. Its scale is measured
# along the axis of the tilt, which a tilt does not shorten. At a larger tilt the height of the
# board is too uncertain: one end of 50 mm rises by 9 mm.
_MAX_FLAT_DEG = 10.0
# Tilts below this are not corrected: one picture shows a tilt to about 3 degrees, and 3 degrees
# shorten a length by 0.1 %.
MEASURABLE_TILT_DEG = 5.0
# Largest residual: a model with a larger one is wrong. Corners are found to 0.02 to 0.2 px on sharp
# pictures.
_MAX_RESIDUAL_PX = 1.0
# Distortion that moves no pixel by more is not worth the resampling.
_MIN_DISTORTION_PX = 0.5
# A further coefficient of distortion counts from this ratio of explained to residual variance on
# (F test with more than 50 degrees of freedom: 1 in 1000).
_SIGNIFICANT_F = 11.0
# Distortion counts if it moves a corner of the board by this many times the residual: errors of
# corners in a small picture of the board grow into pixels at the corners of the frame.
_VISIBLE_DISTORTION = 3.0
# Largest relative standard error of a focal length that is used: view directions of spheres are
# then exact to 5 % of the angle.
_MAX_FOCAL_ERROR = 0.05
# Error of a scale that is fitted together with distortion (test_checkerboard.py has up to 0.04 %).
_DISTORTION_ERROR = 0.0003
# Least number of tilted placements that determine the focal length (Zhang 2000).
_MIN_TILTED = 2
# Flags of OpenCV. The lens is centred, and its pixels are square.
_FIX_DISTORTION = cv2.CALIB_FIX_K1 + cv2.CALIB_FIX_K2
_IDEAL_LENS = (
    cv2.CALIB_FIX_ASPECT_RATIO + cv2.CALIB_FIX_PRINCIPAL_POINT + cv2.CALIB_ZERO_TANGENT_DIST
    + cv2.CALIB_FIX_K3 + cv2.CALIB_USE_INTRINSIC_GUESS
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class _CheckerboardScale:
    """The scale from a checkerboard."""

    scale: Scale
    tilts_deg: Floats  # (J,) of each placement from the image plane, known to about 3 degrees
    distortion_px: float  # the most by which distortion moves a pixel of the frame
    covered: float  # share of the diagonal that the corners reach from the middle


def find_corners(image: Array, corners: tuple[int, int]) -> Floats:
    """(n, 2) columns and rows of the inner corners of a checkerboard in an (H, W) picture."""
    if not all(_CORNER_COUNTS[0] <= count <= _CORNER_COUNTS[1] for count in corners):
        raise InputError(
            f"a checkerboard with {corners[0]} x {corners[1]} inner corners; "
            f"give {_CORNER_COUNTS[0]} to {_CORNER_COUNTS[1]} each"
        )
    # The detector takes 8 bits: stretch the contrast to them.
    values = image.astype(np.float32)
    low, high = (float(level) for level in np.quantile(values[::2, ::2], (0.01, 0.99)))
    grey = np.clip((values - low) * (255.0 / max(high - low, 1e-9)), 0, 255).astype(np.uint8)
    detected = _detected_corners(grey, corners)
    if detected is not None:
        return detected
    fewer = corners[0] - 1, corners[1] - 1
    if min(fewer) >= _CORNER_COUNTS[0] and _detected_corners(grey, fewer) is not None:
        raise CalibrationRejected(
            f"the board has {fewer[0]} x {fewer[1]} inner corners, not {corners[0]} x "
            f"{corners[1]}; count corners where four squares meet, not squares"
        )
    raise CalibrationRejected(
        f"no checkerboard with {corners[0]} x {corners[1]} inner corners is seen; show the whole "
        "board with a white border, sharp, and without reflections"
    )


def _detected_corners(image: npt.NDArray[np.uint8], corners: tuple[int, int]) -> Floats | None:
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    is_found, corners_px = cv2.findChessboardCornersSB(image, corners, flags=flags)
    if not is_found:
        return None
    # The gradients around a corner place it to 0.02 px where the search does to 0.2 px
    # (test_checkerboard.py). The window stays within the four squares.
    grid = corners_px.reshape(corners[1], corners[0], 2)
    spacing = min(float(np.linalg.norm(np.diff(grid, axis=k), axis=2).min()) for k in (0, 1))
    half = int(np.clip(0.3 * spacing, 2, 15))
    ends = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    refined = cv2.cornerSubPix(image, corners_px.astype(np.float32), (half, half), (-1, -1), ends)
    return np.asarray(refined, np.float64).reshape(-1, 2)


def scale_of_boards(
    boards: Sequence[Floats],
    corners: tuple[int, int],
    square_mm: float,
    frame: tuple[int, int],
) -> _CheckerboardScale:
    """Fit scale and radial distortion to (n, 2) corners of one board's placements (Zhang 2000)."""
    if not 0.0 < square_mm < np.inf:
        raise InputError(f"squares of {square_mm:g} mm; give their side, a positive number")
    across, along = np.meshgrid(np.arange(corners[0]), np.arange(corners[1]))
    board = square_mm * np.stack([across.ravel(), along.ravel()], axis=1).astype(np.float64)
    board -= board.mean(axis=0)
    fit, camera, focal_error = _fitted(boards, board, frame)
    if fit.residual_px > _MAX_RESIDUAL_PX:
        raise CalibrationRejected(
            f"the corners are {fit.residual_px:.1f} px off a flat board; count its inner corners "
            "again, glue it to something flat, and keep it still for each picture"
        )
    is_flat = fit.tilts_deg <= _MAX_FLAT_DEG
    if not is_flat.any():
        raise CalibrationRejected(
            f"the board is tilted by {fit.tilts_deg.min():.0f} degrees; lay it flat where the part "
            "will be"
        )
    middle = camera[:2, 2]
    diagonal = np.linspace(0.0, 1.0, 65)[:, None] * middle
    distortion_px = float(np.linalg.norm(_shift(diagonal, fit.radial, camera), axis=1).max())
    mm_per_px = float(fit.mm_per_px[is_flat].mean())
    # Relative errors: of the corners, of the correction of tilts, and between placements.
    extent_px = float(np.sqrt((board**2).sum(axis=1).mean())) / mm_per_px
    noise = fit.residual_px / np.sqrt(len(board)) / extent_px
    tilt_error = 0.5 * (1.0 - float(np.cos(np.radians(fit.tilts_deg[is_flat].max()))))
    spread = float(fit.mm_per_px[is_flat].std()) / mm_per_px
    distortion_error = _DISTORTION_ERROR if fit.radial.any() else 0.0
    is_distorted = distortion_px > _MIN_DISTORTION_PX
    reach = max(float(np.linalg.norm(points - middle, axis=1).max()) for points in boards)
    scale = Scale(
        mm_per_px=mm_per_px,
        error=float(np.sqrt(noise**2 + tilt_error**2 + spread**2 + distortion_error**2)),
        camera_matrix=camera,
        distortion=np.array([*fit.radial, 0.0, 0.0, 0.0]) if is_distorted else None,
        residual_px=fit.residual_px,
        focal_error=focal_error,
    )
    return _CheckerboardScale(
        scale, fit.tilts_deg, distortion_px, reach / float(np.linalg.norm(middle))
    )


def _fitted(
    boards: Sequence[Floats], board: Floats, frame: tuple[int, int]
) -> tuple[_Fit, Floats, float | None]:
    """Fit the lens with as many values as are significant; also its matrix and focal error."""
    fit, camera, focal_error = _fitted_without_distortion(boards, board, frame)
    # Distortion would explain a part of a tilt that a wrong focal length leaves. Its significance
    # is therefore tested between fits with a free focal length.
    free_fit = _Fit.of(boards, board, frame, camera, _FIX_DISTORTION)
    freedom = (2 * len(board) - 6) * len(boards)
    coefficients = 0
    for count, fixed in ((1, cv2.CALIB_FIX_K2), (2, 0)):
        extended_free = _Fit.of(boards, board, frame, camera, fixed)
        extended = _Fit.of(boards, board, frame, camera, fixed + cv2.CALIB_FIX_FOCAL_LENGTH)
        shifts = np.concatenate([_shift(points, extended.radial, camera) for points in boards])
        largest_px = np.linalg.norm(shifts, axis=1).max()
        is_visible = largest_px > _VISIBLE_DISTORTION * extended.residual_px
        explained = free_fit.residual_px**2 - extended_free.residual_px**2
        explained /= count - coefficients
        if is_visible and explained > _SIGNIFICANT_F * extended_free.residual_px**2 / freedom:
            fit, free_fit, coefficients = extended, extended_free, count
    return fit, camera, focal_error


def _fitted_without_distortion(
    boards: Sequence[Floats], board: Floats, frame: tuple[int, int]
) -> tuple[_Fit, Floats, float | None]:
    """Fit, camera matrix, relative error of its focal length; None if that is the nominal one."""
    camera = nominal_camera_matrix(frame)
    fixed = cv2.CALIB_FIX_FOCAL_LENGTH + _FIX_DISTORTION
    fit = _Fit.of(boards, board, frame, camera, fixed)
    if np.count_nonzero(fit.tilts_deg > _MAX_FLAT_DEG) >= _MIN_TILTED:
        free = _Fit.of(boards, board, frame, camera, 0)
        if free.focal_px < 100.0 * max(frame) and free.focal_error <= _MAX_FOCAL_ERROR:
            camera[0, 0] = camera[1, 1] = free.focal_px
            return _Fit.of(boards, board, frame, camera, fixed), camera, free.focal_error
    return fit, camera, None


@dataclass(frozen=True, eq=False)
class _Fit:
    tilts_deg: Floats  # (J,) of each placement from the image plane
    mm_per_px: Floats  # (J,) where the axis of the camera meets the board
    focal_px: float
    focal_error: float  # relative standard error
    radial: Floats  # (2,) k1 and k2 of OpenCV's model
    residual_px: float

    @classmethod
    def of(
        cls,
        boards: Sequence[Floats],
        board: Floats,
        frame: tuple[int, int],
        camera: Floats,
        fixed: int,
    ) -> _Fit:
        """Fit the pose of each placement, and the lens except the values that `fixed` flags."""
        on_board = np.column_stack([board, np.zeros(len(board))]).astype(np.float32)
        in_picture = [points.astype(np.float32)[:, None] for points in boards]
        try:
            residual_px, fitted, distortion, rotations, translations, deviations, *_ = (
                cv2.calibrateCameraExtended(
                    [on_board] * len(boards), in_picture, frame[::-1], camera.copy(), np.zeros(5),
                    flags=_IDEAL_LENS + fixed,
                )
            )  # fmt: skip
        except cv2.error as error:
            raise CalibrationRejected(
                "the corners do not form a board; take the picture again"
            ) from error
        normals = np.array([cv2.Rodrigues(rotation)[0][:, 2] for rotation in rotations])
        # The board is the plane normal . (x - translation) = 0.
        depths = np.einsum("ji,ji->j", normals, np.array(translations)[..., 0]) / normals[:, 2]
        focal_px = float(fitted[0, 0])
        return cls(
            np.degrees(np.arccos(np.clip(np.abs(normals[:, 2]), 0.0, 1.0))),
            depths / focal_px,
            focal_px,
            # With equal aspect the deviation of one of the two may be given as 0.
            float(np.ravel(deviations)[:2].max()) / focal_px,
            np.asarray(distortion, np.float64).ravel()[:2],
            residual_px,
        )


def _shift(points: Floats, radial: Floats, camera: Floats) -> Floats:
    """(n, 2) pixels by which a lens with k1 and k2 of OpenCV's model moves these pixels."""
    offsets = points - camera[:2, 2]
    squared = (offsets**2).sum(axis=1, keepdims=True) / camera[0, 0] ** 2
    return np.asarray(offsets * squared * (radial[0] + squared * radial[1]))
