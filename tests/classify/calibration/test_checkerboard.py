"""The scale and the lens from pictures of a checkerboard."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.base.errors import CalibrationRejected, InputError
from classify.calibration.checkerboard import find_corners, scale_of_boards

FRAME, CORNERS = (480, 640), (9, 6)
FOCAL_PX, SQUARE_PX, SQUARE_MM = 1500.0, 40.0, 5.0
MIDDLE = np.array([319.5, 239.5])


def corners_at(
    tilt: tuple[float, float] = (0.0, 0.0),
    rotation: float = 0.0,
    shift: tuple[float, float] = (0.0, 0.0),
    k1: float = 0.0,
    square_px: float = SQUARE_PX,
    k2: float = 0.0,
    focal_px: float = FOCAL_PX,
) -> np.ndarray:
    """Pixels of the corners of a board at the distance of the focal length."""
    x, y = np.meshgrid(np.arange(CORNERS[0]) - 4.0, np.arange(CORNERS[1]) - 2.5)
    board = square_px * np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
    turn = cv2.Rodrigues(np.array([*tilt, 0.0]))[0] @ cv2.Rodrigues(np.array([0, 0, rotation]))[0]
    points = board @ turn.T + (*shift, focal_px)
    flat = points[:, :2] / points[:, 2:]
    squared = (flat**2).sum(axis=1, keepdims=True)
    return MIDDLE + focal_px * flat * (1.0 + k1 * squared + k2 * squared**2)


def picture(square_px: float = SQUARE_PX, rotation: float = 0.0) -> np.ndarray:
    """A board of 10 x 7 squares on white paper."""
    axes = np.meshgrid(*((np.arange(4 * side) + 0.5) / 4 - 0.5 * side for side in FRAME[::-1]))
    cos, sin = np.cos(rotation), np.sin(rotation)
    x = (cos * axes[0] + sin * axes[1]) / square_px
    y = (cos * axes[1] - sin * axes[0]) / square_px
    black = (np.floor(x) + np.floor(y + 0.5)) % 2 == 0
    board = np.where(black & (abs(x) < 5) & (abs(y) < 3.5), 0.1, 0.8).astype(np.float32)
    image = cv2.GaussianBlur(
        cv2.resize(board, FRAME[::-1], interpolation=cv2.INTER_AREA), (0, 0), 0.7
    )
    noise = 0.01 * np.random.default_rng(0).standard_normal(FRAME)
    return np.rint(255.0 * np.clip(image + noise, 0.0, 1.0)).astype(np.uint8)


@pytest.mark.parametrize(("square_px", "rotation"), [(40.0, 0.0), (22.0, 0.3)])
def test_corners_are_found_to_a_few_hundredths_of_a_pixel(
    square_px: float, rotation: float
) -> None:
    found = find_corners(picture(square_px, rotation), CORNERS)
    true = corners_at(rotation=rotation, square_px=square_px)
    apart = np.linalg.norm(found[:, None] - true[None], axis=2).min(axis=1)
    assert apart.max() < 0.15
    assert np.sqrt((apart**2).mean()) < 0.06


@settings(max_examples=10, deadline=None)
@given(
    st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-3.0, 3.0),
    st.floats(-40.0, 40.0), st.sampled_from([0.0, -0.25, 0.3]), st.integers(0, 1000),
)  # fmt: skip
def test_the_scale_of_a_nearly_flat_board_is_within_its_error(
    tilt_x: float, tilt_y: float, rotation: float, shift: float, k1: float, seed: int
) -> None:
    noise = 0.03 * np.random.default_rng(seed).standard_normal((54, 2))
    board = corners_at((tilt_x, tilt_y), rotation, (shift, -shift), k1) + noise
    found = scale_of_boards([board], CORNERS, SQUARE_MM, FRAME)
    off = found.scale.mm_per_px / (SQUARE_MM / SQUARE_PX) - 1.0
    # The middle of the frame is `shift` from that of the board: a tilt brings it nearer.
    slope = (abs(tilt_x) + abs(tilt_y)) * abs(shift) / FOCAL_PX
    assert abs(off) < 4.0 * found.scale.error + slope + 1e-4
    if k1 == 0.0:
        assert found.distortion_px < 0.5
        assert found.scale.distortion is None


def test_distortion_is_what_the_lens_does() -> None:
    boards = [corners_at(k1=-0.25, rotation=each, shift=(60, 40)) for each in (0.0, 1.6)]
    found = scale_of_boards(boards, CORNERS, SQUARE_MM, FRAME)
    distortion = found.scale.distortion
    assert distortion is not None
    # The undistorted place of the corner of the frame, and where the simulated lens shows it.
    camera = found.scale.camera_matrix
    ideal = cv2.undistortPoints(np.zeros((1, 1, 2)), camera, distortion, P=camera)[0, 0] - MIDDLE
    radius = float(np.linalg.norm(ideal)) / FOCAL_PX
    to_corner = float(np.linalg.norm(MIDDLE))
    assert radius * (1.0 - 0.25 * radius**2) * FOCAL_PX == pytest.approx(to_corner, abs=0.1)
    assert found.distortion_px == pytest.approx(0.25 * to_corner**3 / FOCAL_PX**2, rel=0.02)


def test_a_wide_lens_has_its_scale_within_the_stated_error() -> None:
    noise = 0.03 * np.random.default_rng(1).standard_normal((54, 2))
    board = corners_at(k1=-0.35, square_px=60.0, k2=0.15, focal_px=500.0, shift=(5.0, 5.0)) + noise
    found = scale_of_boards([board], CORNERS, SQUARE_MM, FRAME)
    assert found.scale.mm_per_px == pytest.approx(SQUARE_MM / 60.0, rel=found.scale.error)


def test_tilted_placements_give_the_focal_length() -> None:
    tilts = [(0.0, 0.0), (0.4, 0.0), (0.0, -0.4), (-0.3, 0.3)]
    noise = 0.03 * np.random.default_rng(1).standard_normal((4, 54, 2))
    boards = [corners_at(each) + more for each, more in zip(tilts, noise, strict=True)]
    found = scale_of_boards(boards, CORNERS, SQUARE_MM, FRAME)
    assert found.scale.focal_px == pytest.approx(FOCAL_PX, rel=0.01)
    assert found.scale.mm_per_px == pytest.approx(SQUARE_MM / SQUARE_PX, rel=1e-3)
    flat = scale_of_boards([boards[0]] * 3, CORNERS, SQUARE_MM, FRAME)
    assert flat.scale.focal_px is None


def test_a_board_that_is_tilted_or_bent_is_refused() -> None:
    with pytest.raises(CalibrationRejected, match=r"tilted by 2[0-9] degrees"):
        scale_of_boards([corners_at((0.4, 0.0))], CORNERS, SQUARE_MM, FRAME)
    bent = corners_at()
    bent[:, 1] += 6.0 * np.sin(np.arange(54) % 9)
    with pytest.raises(CalibrationRejected, match="off a flat board"):
        scale_of_boards([bent], CORNERS, SQUARE_MM, FRAME)


def test_another_board_or_none_is_refused() -> None:
    with pytest.raises(CalibrationRejected, match=r"9 x 6 .*not 10 x 7"):
        find_corners(picture(), (10, 7))
    with pytest.raises(CalibrationRejected, match="no checkerboard with 9 x 6"):
        find_corners(np.zeros((100, 120), np.uint8), CORNERS)
    with pytest.raises(InputError, match="2 x 6 inner corners"):
        find_corners(picture(), (2, 6))
    with pytest.raises(InputError, match="squares of nan mm"):
        scale_of_boards([corners_at()], CORNERS, float("nan"), FRAME)
