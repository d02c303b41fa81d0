"""`photometric_stereo`: images under known lights to a `SurfaceEstimate`."""

from collections.abc import Callable
from dataclasses import replace
from pkgutil import resolve_name

import numpy as np

from classify.base.arrays import Array, BoolArray
from classify.base.errors import InputError
from classify.images import Images, ImageStack, SensorNoise
from classify.lighting import Lighting
from classify.lights.fall_off import fall_off
from classify.lights.flat_field import DividedStack, FlatField
from classify.lights.near_light import sheet_of
from classify.methods import SOLVERS, Method, default_method
from classify.surface.estimate import SurfaceEstimate
from classify.surface.uncertainty import with_deviations

from .problem import Maps, Problem

# Images are divided by their full scale and intensity; beyond these limits the squares of the
# results overflow or underflow in float32.
_SMALLEST_DIVISOR, _LARGEST_DIVISOR = 1e-6, 1e12


def photometric_stereo(
    images: Images,
    lighting: Lighting,
    method: Method | None = None,
    *,
    ambient: Array | None = None,
    full_scale: float | None = None,
    noise: SensorNoise | None = None,
    flat_field: FlatField | None = None,
    lobe_exponent: float | None = None,
    planar: bool = False,
    mask: BoolArray | None = None,
    uncertainty: bool = False,
    on_progress: Callable[[float], None] | None = None,
) -> SurfaceEstimate:
    """Gradients and albedo of a Lambertian surface from images under known lights.

    Parameters
    ----------
    images
        (N, H, W) uint8, uint16 or float32, linear in light, in the order of `lighting`.
    lighting
        The N lights. Near lights (`Lighting.positions_px`) have their own direction at each pixel
        (`classify.lights.near_light`); the part lies in the plane from which they are measured.
    method
        ``ps4_robust``, the default for four lights, uses all four at a pixel where they agree
        within the noise, leaves out the one in shadow or in a highlight where they do not, and
        completes pixels with two lights from those around them. ``ps4`` leaves out the darkest
        of four everywhere; ``ps3a`` to ``ps3d`` use three lights of a ring (all but 270, 0, 90
        and 180 degrees). ``least_squares``, the default for any other number, uses all N,
        ``rushmeier`` all but the lowest and the highest of five or more, and ``drbohlav`` all of
        four or more except those whose values are inconsistent with the rest.
    ambient
        (H, W) image with all lights out, of the same dtype, subtracted from each image.
    full_scale
        Pixel value at which the sensor saturates. Pixels that reach it are marked, and the albedo
        is a fraction of it. Without it nothing is marked, and the albedo is in pixel values.
    noise
        Noise of the sensor that took the images. Without it, it is estimated from the images.
    flat_field
        The images of a white matt sheet under these lights, from a calibration. The images are
        divided by it; it contains the intensities of the lights, and those of `lighting` are
        ignored. Without it, images of near lights are divided by the irradiance that the inverse
        square law and Lambert's law predict.
    lobe_exponent
        m of the lobe cos^m of near LEDs, where there is no flat field; see
        `classify.lights.near_light.sheet_of`.
    planar
        The part is flat but for its texture: divide out the fall-off and the levels of near lights
        (`classify.lights.fall_off`). This also takes away a tilt or bow of the part.
    mask
        (H, W) pixels of the part. Others are not valid, and do not count in the fall-off.
    uncertainty
        Add the standard deviations of slopes, albedo and normals; see `SurfaceEstimate`.
    on_progress
        Called with the share of rows solved, 0 to 1, by any thread.

    Returns
    -------
    Maps of slopes, albedo and validity, (H, W) each, with the images and lights they came from.

    Raises
    ------
    InputError
        For another shape, dtype or count of images, NaN, infinity or values beyond 1e12 in a float
        image, a full scale or light intensity out of range, lights that do not suit the method, or
        a mask or flat field that does not fit the images.

    Notes
    -----
    i = rho n . l, so that b = rho n solves L b = i; p = -b_x / b_z, q = -b_y / b_z, rho = |b|. PS4
    is that of J. Wu, thesis chapter 9. The functions of the other methods name their sources.

    Examples
    --------
    >>> import numpy as np
    >>> lighting = Lighting.ring(slant_deg=45.0)
    >>> tilted = np.array([-0.2, 0.1, 1.0]) / np.sqrt(1.05)
    >>> values = (100 * lighting.directions @ tilted).astype(np.float32)
    >>> surface = photometric_stereo(np.tile(values[:, None, None], (1, 2, 2)), lighting)
    >>> round(float(surface.p[0, 0]), 3), round(float(surface.q[0, 0]), 3)
    (0.2, -0.1)
    """
    chosen = method or default_method(len(lighting))
    if chosen not in SOLVERS:
        raise InputError(f"unknown method {chosen!r}; choose one of {', '.join(SOLVERS)}")
    stack = ImageStack.checked(images, len(lighting), ambient)
    _check_divisors(full_scale, lighting)
    if mask is not None and mask.shape != stack.shape:
        raise InputError(f"the mask has shape {mask.shape}, the images {stack.shape}")
    undivided = stack
    solver_lighting, divided_by = lighting, None
    unit_lighting = replace(lighting, intensities=np.ones(len(lighting)))
    saturation = np.float32(np.inf if full_scale is None else full_scale)
    sheet = flat_field
    if flat_field is not None:
        solver_lighting = unit_lighting  # the flat field contains the intensities
    elif lighting.positions_px is not None:
        sheet = sheet_of(unit_lighting, stack.shape, lobe_exponent)
    if sheet is not None:
        divided_by = sheet.without_cosines(lighting)
        stack = DividedStack(stack.images, stack.ambient, divided_by, full_scale)
        saturation = divided_by.saturation(float(saturation))
    # The images of a planar part are divided before the fall-off is fitted to them.
    fitted_fall_off, image_saturation = None, float(saturation)
    if planar:
        stack, divided_by = stack.materialised(), None
        fitted_fall_off = fall_off(stack, solver_lighting, image_saturation, mask)
    if fitted_fall_off is not None:
        divided_by = fitted_fall_off
        stack = DividedStack(stack.images, stack.ambient, divided_by, image_saturation)
        saturation = divided_by.saturation(image_saturation)
        # Marks the intensities as given: the fall-off contains the LED levels, which the solver
        # must not estimate again.
        solver_lighting = replace(solver_lighting, intensities=solver_lighting.intensities)
    problem = Problem(stack, solver_lighting, full_scale, noise, saturation, on_progress)
    maps: Maps = resolve_name(f"{__package__}.{SOLVERS[chosen].function}")(problem)
    surface = SurfaceEstimate(
        p=maps.p,
        q=maps.q,
        albedo=maps.albedo,
        valid=maps.valid,
        method=chosen,
        images=stack.images,
        ambient=stack.ambient,
        full_scale=full_scale,
        lighting=maps.lighting,
        planar=planar,
        divided_by=divided_by,
        saturation=image_saturation if planar else full_scale,
        fall_off=fitted_fall_off,
        led_levels=None if maps.lighting is solver_lighting else maps.lighting.intensities,
        left_out=maps.left_out,
        highlights=maps.highlights,
        repaired=maps.repaired,
        noise_given=noise is not None,
    )
    if uncertainty:
        surface = with_deviations(surface, stack, undivided, problem.noise_coefficients)
    return surface if mask is None else surface.within(mask)


def _check_divisors(full_scale: float | None, lighting: Lighting) -> None:
    if full_scale is not None and not 0.0 < full_scale < np.inf:
        raise InputError(f"full_scale is {full_scale}; it must be a positive pixel value")
    for light, divisor in enumerate((full_scale or 1.0) * lighting.intensities):
        if not _SMALLEST_DIVISOR <= divisor <= _LARGEST_DIVISOR:
            raise InputError(
                f"full_scale times the intensity of light {light} is {divisor:g}; give values "
                f"from {_SMALLEST_DIVISOR:g} to {_LARGEST_DIVISOR:g}"
            )
