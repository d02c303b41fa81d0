"""Sensors of a simulated camera: a noise model, or the pixel values of a recorded set."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.base.arrays import FloatMap
from rig.cameras.camera import Pixels


def quantised(values: npt.NDArray[np.floating[Any]], bit_depth: int) -> Pixels:
    """Round and clip values to a bit depth: uint8 for 8 bits, else uint16."""
    rounded = np.clip(np.rint(values), 0, (1 << bit_depth) - 1)
    pixels: Pixels = rounded.astype(np.uint8 if bit_depth == 8 else np.uint16)
    return pixels


@dataclass(frozen=True)
class SensorModel:
    """A monochrome sensor of a common industrial camera."""

    bit_depth: int = 12
    full_well_e: float = 10_000.0  # electrons of a saturated pixel, at the highest pixel value
    read_noise_e: float = 5.0  # rms
    white_e_per_ms: float = 425.0  # white that faces one LED: 85 % of the well in 20 ms
    # Share of the highest pixel value, so that noise around 0 is not cut.
    black_level_fraction: float = 1.0 / 64.0
    response_gamma: float = 1.0  # linear shares of full scale are raised to 1 / gamma
    hot_pixels: int = 0  # number of pixels that are too bright by 10 to 100 % of the full well

    @property
    def full_scale_dn(self) -> int:
        """Highest pixel value, 2^bit_depth - 1."""
        return (1 << self.bit_depth) - 1

    @property
    def black_level_dn(self) -> float:
        """Pixel value without light."""
        return self.full_scale_dn * self.black_level_fraction

    @property
    def gain_e_per_dn(self) -> float:
        """Electrons per step of the converter."""
        return self.full_well_e / (self.full_scale_dn - self.black_level_dn)

    @property
    def info_fields(self) -> Mapping[str, Any]:
        """Gain in pixel values per electron, gamma and black level, as in `CameraInfo`."""
        controls = {"black_level": self.black_level_dn}
        gain = 1.0 / self.gain_e_per_dn
        return {"gain": gain, "gamma": self.response_gamma, "pixel_value_controls": controls}

    @property
    def read_noise_dn(self) -> float:
        """Rms read noise in pixel values."""
        return self.read_noise_e / self.gain_e_per_dn

    def expose(self, light_ms: FloatMap, rng: np.random.Generator) -> Pixels:
        """Pixel values; `light_ms` is 1 for white that faces one LED for a millisecond."""
        signal = self.expose_unclipped(light_ms, rng)
        # 0.5: conversion to integers rounds down.
        signal += np.float32(self.black_level_dn + 0.5)
        if self.hot_pixels:
            indices, excess_dn = self._hot_pixels(signal.size)
            signal.flat[indices] += excess_dn
        if self.response_gamma != 1.0:
            fraction = np.maximum(signal - np.float32(0.5), 0.0) / np.float32(self.full_scale_dn)
            signal = fraction ** np.float32(1.0 / self.response_gamma)
            signal *= np.float32(self.full_scale_dn)
            signal += np.float32(0.5)
        np.clip(signal, 0, self.full_scale_dn, out=signal)
        if self.bit_depth == 8:
            return signal.astype(np.uint8)
        return signal.astype(np.uint16)

    def _hot_pixels(self, pixel_count: int) -> tuple[npt.NDArray[np.int64], FloatMap]:
        """Flat indices of the hot pixels, the same in all frames, and the values that they add."""
        rng = np.random.default_rng((self.hot_pixels, pixel_count))
        indices = rng.choice(pixel_count, self.hot_pixels, replace=False)
        shares = rng.uniform(0.1, 1.0, self.hot_pixels)
        return indices, (shares * self.full_well_e / self.gain_e_per_dn).astype(np.float32)

    def expose_unclipped(self, light_ms: FloatMap, rng: np.random.Generator) -> FloatMap:
        """(H, W) float32 noisy values above the black level, neither clipped nor rounded."""
        signal = light_ms * np.float32(self.white_e_per_ms)
        noise = np.abs(signal)
        noise += np.float32(self.read_noise_e**2)
        np.sqrt(noise, out=noise)
        noise *= rng.standard_normal(light_ms.shape, dtype=np.float32)
        signal += noise
        signal *= np.float32(1.0 / self.gain_e_per_dn)
        return signal


@dataclass(frozen=True)
class RecordedPixels:
    """Recorded pixel values, with their own noise, in place of a sensor."""

    bit_depth: int
    exposure_ms: float
    origin: Mapping[str, Any]
    gain_e_per_dn: float | None
    read_noise_dn: float | None
    black_level_dn: float | None
    info_fields: Mapping[str, Any]

    def expose(self, light_ms: FloatMap, _rng: np.random.Generator) -> Pixels:
        """Pixel values for an exposure; `light_ms` is pixel values times milliseconds."""
        return quantised(light_ms / np.float32(self.exposure_ms), self.bit_depth)


Sensor = SensorModel | RecordedPixels
