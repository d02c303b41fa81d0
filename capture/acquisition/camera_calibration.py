"""Frames for the calibration of a camera: lens covered, and exposure ladder."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from capture.procedures.camera_parts import Rung, levels_of
from classify.calibration.calibration import Calibration
from classify.calibration.dark_frames import DarkFrames, dark_of
from rig import Rig
from rig.cameras.camera import Pixels

from .frame_series import (
    brightest_light,
    frame_series,
    ladder_frames,
    ladder_ms,
    restored_exposure,
)

# Hot pixels are those beyond the noise of one frame, which 16 frames average away.
_DARK_FRAMES = 16
# Frames at each exposure. Their differences show the noise, with three degrees of freedom.
_LADDER_FRAMES = 4

Series = tuple[float, Pixels]


def _unshown(items: Iterator[Series], _: int) -> Iterable[Series]:
    return items


def dark_of_rig(rig: Rig) -> DarkFrames:
    """Measure frames of a rig with its lens covered; its LEDs must not change them."""
    frames = frame_series(rig, None, _DARK_FRAMES)
    lit = np.concatenate([frame_series(rig, light, 1) for light in range(len(rig.lighting))])
    return dark_of(frames, (1 << rig.camera.info.bit_depth) - 1, lit)


def rungs_of_rig(
    rig: Rig,
    calibration: Calibration,
    shown: Callable[[Iterator[Series], int], Iterable[Series]] = _unshown,
) -> list[Rung]:
    """Capture a ladder of exposures of a white sheet, and restore the exposure.

    `shown` draws a progress bar: it gets the frames of all exposures and their number, and yields
    the frames.
    """
    bit_depth = rig.camera.info.bit_depth
    full_scale = (1 << bit_depth) - 1
    with restored_exposure(rig):
        light = brightest_light(rig)
        exposures_ms = ladder_ms(rig, light)
        series = ladder_frames(rig, light, exposures_ms, _LADDER_FRAMES)
        return [
            Rung(exposure_ms, levels_of(frames, full_scale, bit_depth, calibration))
            for exposure_ms, frames in shown(series, len(exposures_ms))
        ]
