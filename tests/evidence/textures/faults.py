"""Faults of a rig from one day to the next, in simulated sets."""

import math
from dataclasses import dataclass, replace

import numpy as np

from classify import Lighting
from rig.scene.render import DISTANT, Lens, SceneImages, render_frame
from rig.scene.surfaces import PeriodicSurface


@dataclass(frozen=True)
class Faults:
    """Bounds of the faults of a set; the solver knows of none, and every set draws its own.

    Attributes
    ----------
    blur_px
        Range of the standard deviation of a Gaussian blur: the camera is out of focus.
    fall_off
        Share by which the light of each LED is weaker at the far end of the frame: near LEDs.
    weak_leds
        Largest share of its light that an LED lacks.
    slant_deg
        Difference of the true slant from the given one, of either sign.
    magnification
        Factor of the magnification against training, or its inverse.
    ambient
        Ambient light that is not in the ambient image, as a share of the light of one LED.
    vignetting
        Share of light missing in the corners of the frame.
    """

    blur_px: tuple[float, float] = (0.0, 0.0)
    fall_off: float = 0.0
    weak_leds: float = 0.0
    slant_deg: float = 0.0
    magnification: float = 1.0
    ambient: float = 0.0
    vignetting: float = 0.0

    def __call__(
        self,
        surface: PeriodicSurface,
        slant_deg: float,
        size_px: int,
        rotate_deg: float,
        shift_px: tuple[float, float],
        seed: int,
    ) -> SceneImages:
        """Render a frame under the ring of four lights with faults drawn by `seed`."""
        rng = np.random.default_rng(seed)
        sign, other_sign = rng.choice((-1.0, 1.0), 2)
        levels = 1.0 - rng.uniform(0.0, self.weak_leds, 4)
        true_slant_deg = slant_deg + float(sign) * self.slant_deg
        scene = render_frame(
            surface,
            Lighting(Lighting.ring(true_slant_deg).directions, levels),
            size_px,
            rotate_deg,
            shift_px,
            magnification=self.magnification ** float(other_sign),
            led_distance_px=led_distance_for(self.fall_off, true_slant_deg, size_px),
        )
        seen = Lens(float(rng.uniform(*self.blur_px)), self.vignetting).images(scene)
        return replace(seen, lights=seen.lights + np.float32(self.ambient) * seen.albedo)


def led_distance_for(fall_off: float, slant_deg: float, size_px: int) -> float:
    """Distance in pixels of an isotropic LED whose light falls by `fall_off` across a frame."""
    # Irradiance of a level surface is proportional to 1 / r^3 at the same height of the light.
    ratio = math.pow(1.0 - fall_off, -2.0 / 3.0)  # of the squared distances: (1 + u) / (1 - u)
    u = (ratio - 1.0) / (ratio + 1.0)
    # r^2 = D^2 + h^2 +- 2 D h sin(slant), h half the frame: u = 2 D h sin(slant) / (D^2 + h^2)
    half_px, sine = 0.5 * size_px, math.sin(math.radians(slant_deg))
    return half_px * (sine + math.sqrt(sine * sine - u * u)) / u if u else DISTANT


OUT_OF_FOCUS = Faults(blur_px=(0.5, 1.1))
NEAR_LEDS = Faults(fall_off=0.25)
OTHER_RIG = Faults(weak_leds=0.08, slant_deg=3.0, magnification=1.05, ambient=0.05, vignetting=0.2)
ALL_FAULTS = replace(OTHER_RIG, blur_px=OUT_OF_FOCUS.blur_px, fall_off=NEAR_LEDS.fall_off)
