"""Reading a DNG, the raw data of a camera, by LibRaw (`pip install 'ps4rig[dng]'`)."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.errors import InputError

# EXIF orientations of LibRaw's codes for a flip.
_ORIENTATIONS = {0: 1, 3: 3, 5: 8, 6: 6}


def read_dng(path: Path) -> tuple[npt.NDArray[np.uint16], int]:
    """Read a DNG as (H, W, 3) linear camera RGB, and its EXIF orientation.

    The orientation is not undone. Black level is 0 and white level 65535. There is no white balance
    and no colour matrix, so that a pixel depends on the light in it only. Missing colours are the
    mean of their neighbours.

    Raises
    ------
    InputError
        If `rawpy` is not installed, or the file is missing or cannot be decoded.
    """
    try:
        import rawpy
    except ImportError:
        raise InputError(
            f"{path}: a DNG is read by rawpy, which is not installed: pip install 'ps4rig[dng]'"
        ) from None
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        with rawpy.imread(str(path)) as raw:
            flip = int(raw.sizes.flip)  # read first: `user_flip` replaces it
            linear: npt.NDArray[Any] = raw.postprocess(
                gamma=(1, 1), no_auto_bright=True, adjust_maximum_thr=0.0, output_bps=16,
                user_wb=[1.0] * 4, output_color=rawpy.ColorSpace.raw, user_flip=0,
                demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
            )  # fmt: skip
    except rawpy.LibRawError as error:
        raise InputError(f"{path}: not a readable DNG ({error})") from error
    return np.ascontiguousarray(linear, np.uint16), _ORIENTATIONS.get(flip, 1)
