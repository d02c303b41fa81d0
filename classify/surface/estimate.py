"""`SurfaceEstimate`, the result of a solver."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, BoolArray, Floats
from classify.base.arrays import FloatMap as FloatMap
from classify.base.errors import InputError
from classify.base.threads import run_on_rows
from classify.images import ImageStack, sample_pixels
from classify.lighting import Lighting
from classify.lights.flat_field import DividedStack, FlatField
from classify.lights.near_light import Shear, coordinates_px

from .diagnostics import compare_with_prediction, find_darkest, fit_residual, highlight_limits

# Number of pixels from which the limits of highlights are estimated: it determines a median to 2 %.
_SAMPLES = 4096
_MIN_ALBEDO = np.float32(1e-9)


@dataclass(frozen=True, eq=False)
class SurfaceEstimate:
    """Gradient field, albedo, and maps of where they can be trusted, each (H, W).

    The solver writes p, q, albedo and `valid`, and some methods also what was left out or repaired
    at each pixel. `residual`, `shadow_count`, `saturated`, and for some methods `dropped` and
    `specular`, are computed from these and the images when they are first read. The images are
    not copied: do not change them until these maps have been read.

    Attributes
    ----------
    p, q
        float32 gradients dz/dx and dz/dy (y up); 0 where no slope can be determined.
    albedo
        float32, as a fraction of full scale, or in units of the images if that is not known.
    valid
        bool, false where no slope can be determined: fewer than three of the lights used are out
        of shadow (fewer than two for ps4_robust, which repairs), a light used is saturated, the
        solution faces away from the camera, the standard error of the slope from the noise of
        these images exceeds 0.5, or a light is missing at a pixel that is black beside the rest of
        the frame, as a backdrop is.
    method
        Name of the solver.
    images, ambient, full_scale
        (N, H, W) the images that were solved, with the (H, W) ambient image and the full scale,
        as they were given or, for a planar part, divided by a flat field; None for an estimate that
        does not come from a solver.
    lighting
        The N lights of these images, with the intensities that were used.
    planar
        Whether the part was solved as planar: then a tilt or bow of it is not in the slopes.
    divided_by
        Flat field by which the images are divided where they are read: that of a calibration, of
        near lights, or the fall-off over a planar part; or None.
    saturation
        Value of saturated pixels of the images; None for `full_scale`.
    fall_off
        Fall-off of the lights over a planar part; None for other parts, or if too little of the
        part was lit.
    led_levels
        (N,) intensities that ps4_robust estimated from the images (`level_corrections`); None where
        the intensities were given, and for other methods.
    left_out
        See `dropped`; None where that is the darkest light everywhere.
    highlights
        See `specular`; None where that follows from the prediction of the solution.
    repaired
        bool, true where fewer than three lights were usable and the slope, with one light or none
        the albedo too, comes from the pixels around (ps4_robust only).
    p_sd, q_sd, albedo_sd, angle_sd
        float32 standard deviations of p, q and albedo, and of the normal in degrees, by noise and
        model errors at each pixel; 95 % of the errors are within 1.96 times them. Only with
        ``uncertainty=True``. Errors of the calibration are not included.
    noise_given
        Whether the noise of the sensor was given, not estimated from the images.
    mask
        bool, false outside the part: no pixel there is valid, in shadow or a highlight. None for
        the whole frame.
    """

    p: FloatMap
    q: FloatMap
    albedo: FloatMap
    valid: BoolArray
    method: str
    images: Array | None = None
    ambient: Array | None = None
    full_scale: float | None = None
    lighting: Lighting | None = None
    planar: bool = False
    divided_by: FlatField | None = None
    saturation: float | None = None
    fall_off: FlatField | None = None
    led_levels: Floats | None = None
    left_out: npt.NDArray[np.uint8] | None = None
    highlights: BoolArray | None = None
    repaired: BoolArray | None = None
    p_sd: FloatMap | None = None
    q_sd: FloatMap | None = None
    albedo_sd: FloatMap | None = None
    angle_sd: FloatMap | None = None
    noise_given: bool = False
    mask: BoolArray | None = None

    @cached_property
    def dropped(self) -> npt.NDArray[np.uint8]:
        """(H, W) uint8 index of the light left out, 255 where all were used.

        Where several were left out, or were equally dark, it is the first of them; for rushmeier
        it is the darkest.
        """
        if self.left_out is not None:
            return self.left_out
        stack, _ = self._stack_and_lights
        darkest = np.zeros(self.shape, np.uint8)

        def find(first: int, last: int) -> None:
            find_darkest(*stack.float_rows(first, last), self._gains, darkest[first:last])

        run_on_rows(find, self.shape)
        return darkest

    @cached_property
    def residual(self) -> FloatMap:
        """(H, W) float32 rms difference between the light images and a Lambertian surface.

        It is the residual of a least squares fit to all lights, whatever the method, in units of
        the albedo. Shadow, highlights, noise and a wrong light order all raise it.
        """
        stack, lighting = self._stack_and_lights
        directions = lighting.directions.astype(np.float32)
        weights = np.linalg.pinv(lighting.directions).astype(np.float32)
        residual = np.empty(self.shape, np.float32)
        shear, (x, y) = Shear.of(lighting), coordinates_px(self.shape)

        def fit(first: int, last: int) -> None:
            fit_residual(
                *stack.float_rows(first, last), self._gains, weights, directions, shear.plane,
                shear.excess, x, y[first:last], residual[first:last],
            )  # fmt: skip

        run_on_rows(fit, self.shape)
        return residual

    @property
    def residual_share(self) -> float | None:
        """Median of `residual` over the albedo of valid pixels; None if there are none.

        Three lights leave no residual, so that it is None for these too.
        """
        if len(self._stack_and_lights[1]) < 4:
            return None
        shares = self.residual[self.valid] / np.maximum(self.albedo[self.valid], _MIN_ALBEDO)
        return float(np.median(shares)) if shares.size else None

    @property
    def shadow_count(self) -> npt.NDArray[np.uint8]:
        """(H, W) uint8 number of lights in shadow.

        A light counts if it gives at most half of what this solution predicts
        (`classify.shadow_rule`), in cast or attached shadow. It is 0 where no slope is known, as on
        a black backdrop. Divided by the number of lights it is the shadow image of figure 9.7 of
        Wu's thesis.
        """
        return self._shadows_and_highlights[0]

    @property
    def shadow_mask(self) -> BoolArray:
        """(H, W) bool, true where at least one light is in shadow."""
        mask: BoolArray = self.shadow_count > 0
        return mask

    @cached_property
    def saturated(self) -> BoolArray:
        """(H, W) bool, true where any image reached full scale."""
        stack, _ = self._stack_and_lights
        limit = np.inf if self._saturated_value is None else self._saturated_value
        saturated: BoolArray = stack.images.max(axis=0) >= limit
        return saturated

    @property
    def specular(self) -> BoolArray:
        """(H, W) bool, true where a highlight is suspected.

        A light exceeds the prediction of the solution by half, and by more than wrong intensities
        and fall-off explain (`highlight_limits`). For ps4_robust and drbohlav it is also a light
        that they left out. ps4, which relies on the three brightest lights, finds none.
        """
        return self._shadows_and_highlights[1]

    @property
    def solved_images(self) -> Array | None:
        """(N, H, W) images as solved: divided by `divided_by`; None without images."""
        if self.images is None or self.divided_by is None:
            return self.images
        return self._stack_and_lights[0].materialised().images

    def within(self, mask: BoolArray) -> Self:
        """Return this surface with no slope, shadow or highlight outside `mask` (H, W)."""
        zero = np.float32(0.0)
        return replace(
            self,
            p=np.where(mask, self.p, zero),
            q=np.where(mask, self.q, zero),
            valid=self.valid & mask,
            highlights=None if self.highlights is None else self.highlights & mask,
            mask=mask,
        )

    @property
    def inscribed(self) -> Self:
        """The largest square within the mask, without images; without a mask this surface.

        A texture is compared there, because spectra would count the outline of a mask as texture.
        """
        return self if self.mask is None else self.cropped(*inscribed_square(self.mask))

    def cropped(self, rows: slice, columns: slice) -> Self:
        """Return a part of this surface, with shadows and highlights, without images.

        Lights and flat field refer to the whole frame, so that images of a part do not fit them.
        """

        def cut(plane: Any) -> Any:
            return None if plane is None else np.ascontiguousarray(plane[rows, columns])

        planes = (
            "p", "q", "albedo", "valid", "left_out", "highlights", "repaired", "mask",
            "p_sd", "q_sd", "albedo_sd", "angle_sd",
        )  # fmt: skip
        part = replace(
            self,
            images=None,
            ambient=None,
            divided_by=None,
            **{name: cut(getattr(self, name)) for name in planes},
        )
        if self.images is not None:
            # Fill the cached property, which the part cannot compute without images.
            vars(part)["_shadows_and_highlights"] = tuple(map(cut, self._shadows_and_highlights))
        return part

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.p.shape
        return rows, columns

    @property
    def normals(self) -> FloatMap:
        """(H, W, 3) float32 unit normals (x right, y up, z to the camera)."""
        normals = np.empty((*self.shape, 3), dtype=np.float32)
        inverse = 1.0 / np.sqrt(1.0 + self.p**2 + self.q**2)
        normals[..., 0] = -self.p * inverse
        normals[..., 1] = -self.q * inverse
        normals[..., 2] = inverse
        return normals

    @cached_property
    def _shadows_and_highlights(self) -> tuple[npt.NDArray[np.uint8], BoolArray]:
        stack, lighting = self._stack_and_lights
        directions = lighting.directions.astype(np.float32)
        shadow_count, highlights = np.empty(self.shape, np.uint8), np.empty(self.shape, np.bool_)
        pixels = sample_pixels(self.shape, _SAMPLES)
        pixels = pixels[self.valid.ravel()[pixels]]
        inverse_distances, (x, y) = Shear.of(lighting).inverse_distances, coordinates_px(self.shape)
        limits = highlight_limits(
            stack.values_at(pixels) * self._gains[:, None], directions, inverse_distances,
            x[pixels % len(x)], y[pixels // len(x)],
            *(plane.ravel()[pixels] for plane in (self.p, self.q, self.albedo)),
        )  # fmt: skip

        def compare(first: int, last: int) -> None:
            rows = slice(first, last)
            compare_with_prediction(
                *stack.float_rows(first, last), self._gains, directions, inverse_distances,
                x, y[rows], self.p[rows], self.q[rows], self.albedo[rows], self._determined(rows),
                limits, shadow_count[rows], highlights[rows],
            )  # fmt: skip

        run_on_rows(compare, self.shape)
        if self.highlights is not None:
            highlights &= self.highlights
        return shadow_count, highlights

    def _determined(self, rows: slice) -> BoolArray:
        """Where a slope is known, also from too few lights for a valid one."""
        sloped = (self.p[rows] != 0.0) | (self.q[rows] != 0.0)
        determined: BoolArray = self.valid[rows] | sloped
        if self.repaired is not None:
            determined |= self.repaired[rows]
        if self.mask is not None:
            determined &= self.mask[rows]
        return determined

    @property
    def _stack_and_lights(self) -> tuple[ImageStack, Lighting]:
        if self.images is None or self.lighting is None:
            raise InputError(
                "this estimate has no images with their lights, from which shadow, residual and "
                "saturation are computed; only `photometric_stereo` provides them"
            )
        if self.divided_by is None:
            return ImageStack(self.images, self.ambient), self.lighting
        stack = DividedStack(self.images, self.ambient, self.divided_by, self._saturated_value)
        return stack, self.lighting

    @property
    def _saturated_value(self) -> float | None:
        return self.full_scale if self.saturation is None else self.saturation

    @property
    def _gains(self) -> FloatMap:
        """(N,) factors from pixel values to units of the albedo."""
        intensities = self._stack_and_lights[1].intensities
        return (1.0 / ((self.full_scale or 1.0) * intensities)).astype(np.float32)


def inscribed_square(mask: BoolArray) -> tuple[slice, slice]:
    """Rows and columns of the largest square in which an (H, W) mask is true."""
    # Chessboard distance to the nearest false pixel; all pixels beyond the border are false.
    distances = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_C, 3)[1:-1, 1:-1]
    radius = int(distances.max())
    # A square of an even side has four middle pixels.
    pairs = np.minimum(distances[:-1], distances[1:])
    of_four = np.minimum(pairs[:, :-1], pairs[:, 1:])
    is_even = radius > 0 and of_four.max(initial=0.0) == radius
    centres = of_four if is_even else distances
    row, column = np.unravel_index(np.argmax(centres), centres.shape)
    side = 2 * radius if is_even else 2 * radius - 1
    top, left = int(row) - radius + 1, int(column) - radius + 1
    return slice(top, top + side), slice(left, left + side)
