"""The scale of the image, and the distortion of the lens."""

from dataclasses import dataclass

import numpy as np

from classify.base.arrays import Floats
from classify.base.errors import InputError


@dataclass(frozen=True, eq=False)
class Scale:
    """Length of a pixel at the plane of the part, and the geometry of the lens."""

    mm_per_px: float
    error: float  # standard error of `mm_per_px`, as a share of it
    camera_matrix: Floats  # (3, 3) of OpenCV's camera model, in pixels
    distortion: Floats | None  # (5,) k1, k2, p1, p2, k3; None if below 0.5 px
    residual_px: float  # rms distance of the corners of the checkerboard from the model
    focal_error: float | None = None  # as a share; None for `nominal_camera_matrix`

    @property
    def focal_px(self) -> float | None:
        """The focal length in pixels, where it was measured."""
        return None if self.focal_error is None else float(self.camera_matrix[0, 0])

    def __post_init__(self) -> None:
        if not 1e-6 <= self.mm_per_px <= 1e3:
            raise InputError(f"scale of {self.mm_per_px:g} mm per px; give 1e-6 to 1000")
        if not (0.0 <= self.error < np.inf and 0.0 <= self.residual_px < np.inf):
            raise InputError(
                f"scale with an error of {self.error:g} and a residual of {self.residual_px:g} px; "
                "give finite numbers of 0 or more"
            )
        if self.camera_matrix.shape != (3, 3) or not np.isfinite(self.camera_matrix).all():
            raise InputError(f"camera matrix is {self.camera_matrix.shape}; give finite (3, 3)")
        distortion = self.distortion
        if distortion is not None and not (
            distortion.shape == (5,) and np.isfinite(distortion).all()
        ):
            raise InputError(f"distortion is {distortion.shape}; give 5 finite coefficients")
        if self.focal_error is not None and not (
            0.0 <= self.focal_error < np.inf and self.camera_matrix[0, 0] > 0.0
        ):
            raise InputError(
                f"focal length of {self.camera_matrix[0, 0]:g} px with an error of "
                f"{self.focal_error:g}; give positive numbers"
            )


def nominal_camera_matrix(frame: tuple[int, int]) -> Floats:
    """Camera matrix with twice the longer side for an unknown focal length."""
    rows, columns = frame
    focal_px = 2.0 * max(rows, columns)
    middle = 0.5 * (columns - 1), 0.5 * (rows - 1)
    return np.array([[focal_px, 0.0, middle[0]], [0.0, focal_px, middle[1]], [0.0, 0.0, 1.0]])
