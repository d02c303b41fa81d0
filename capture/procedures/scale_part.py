"""The scale of a calibration, from pictures of a checkerboard, with its record."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from capture.calibration.ps4cal import MeasuredPart, stated_error
from capture.calibration.setting import Setting
from capture.sets.captured_set import CapturedSet
from classify.base.errors import CalibrationRejected
from classify.calibration.checkerboard import SEEN_TILT_DEG, find_corners, scale_of_boards

# Relative errors of a length that the record calls good and fair.
_GOOD, _FAIR = 0.002, 0.01
# Share of the way to the frame's corners that the board should reach to show distortion.
_COVERED = 0.6


def board_of_set(captured: CapturedSet) -> npt.NDArray[np.float32]:
    """Return the mean of the light images of a set, (H, W): it has the least noise and shadow."""
    return np.asarray(captured.images.mean(axis=0, dtype=np.float32), np.float32)


def scale_part(
    pictures: Sequence[npt.NDArray[np.generic]],
    corners: tuple[int, int],
    square_mm: float,
    setting: Setting,
    source: Sequence[str],
) -> MeasuredPart:
    """Measure the scale from one picture per placement of a checkerboard."""
    boards = []
    for number, picture in enumerate(pictures, start=1):
        try:
            boards.append(find_corners(picture, corners))
        except CalibrationRejected as error:
            where = f"placement {number}: " if len(pictures) > 1 else ""
            raise CalibrationRejected(f"{where}{error}") from error
    fit = scale_of_boards(boards, corners, square_mm, (setting.height_px, setting.width_px))
    scale = fit.scale
    word = "Good" if scale.error <= _GOOD else "Fair" if scale.error <= _FAIR else "Poor"
    lens = (
        f"the lens moves pixels by up to {fit.distortion_px:.1f} px, which is corrected"
        if scale.distortion is not None
        else "no distortion of the lens beyond half a pixel is seen"
    )
    quality = (
        f"{word}: {scale.mm_per_px:.5g} mm per px, known to {stated_error(scale.error, 2)}; {lens}."
    )
    if scale.error > _FAIR:
        quality += " Lay the board flat where the part will be, and let it fill the frame."
    figures = {
        "mm_per_px": scale.mm_per_px,
        "error": scale.error,
        "residual_px": scale.residual_px,
        "distortion_px": fit.distortion_px,
        "smallest_tilt_deg": float(fit.tilts_deg.min()),
        "frame_covered": fit.covered,
        "placements": float(len(boards)),
    }
    if scale.focal_px is not None and scale.focal_error is not None:
        figures |= {"focal_length_px": scale.focal_px, "focal_error": scale.focal_error}
    warnings = []
    if fit.tilts_deg.min() > SEEN_TILT_DEG:
        warnings.append(
            f"the board is tilted by {fit.tilts_deg.min():.1f} degrees; its scale is that along "
            "the axis of the tilt"
        )
    if fit.covered < _COVERED:
        warnings.append(
            f"the board reaches {fit.covered:.0%} of the way to the corners of the frame; what "
            "the lens does farther out is not seen"
        )
    return MeasuredPart.now("scale", scale, setting, quality, figures, source, warnings)
