"""The camera without light: offset, hot pixels, noise of one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from classify.base.errors import InputError

SAME_EXPOSURE = 0.02
"""Largest relative difference of equal exposures, which cameras round when they read them back."""
_MOST_EXPOSURES = 16


@dataclass(frozen=True, eq=False)
class Dark:
    """Offset, noise and hot pixels, in pixel values, at one gain and one exposure or several."""

    offset: float  # without light
    noise: float  # temporal standard deviation of a pixel in one frame
    hot_pixels: npt.NDArray[np.int32]  # (n, 2) rows and columns
    ambient: float | None  # ambient light with all LEDs off, less `offset`; None if unknown
    full_scale: float  # pixel value of saturation to which the values above belong
    exposure_ms: float | None = None  # of the values above; None if unknown
    longer: Dark | None = None  # at the next longer measured exposure; None for the longest

    def __post_init__(self) -> None:
        if not (0.0 < self.full_scale < np.inf and 0.0 <= self.offset < self.full_scale):
            raise InputError(
                f"dark offset {self.offset:g} of full scale {self.full_scale:g}; give "
                "an offset from 0 to below full scale"
            )
        if not 0.0 <= self.noise <= self.full_scale:
            raise InputError(
                f"dark noise {self.noise:g} of full scale {self.full_scale:g}; give 0 to full scale"
            )
        if self.ambient is not None and not abs(self.ambient) <= self.full_scale:
            raise InputError(
                f"ambient light {self.ambient:g} of full scale {self.full_scale:g}; give a value "
                "within full scale"
            )
        pixels = self.hot_pixels
        if pixels.ndim != 2 or pixels.shape[1] != 2 or pixels.dtype != np.int32:
            raise InputError(
                f"hot pixels are {pixels.shape} {pixels.dtype}; give (n, 2) int32 rows and columns"
            )
        if pixels.size and pixels.min() < 0:
            raise InputError(f"a hot pixel has the row or column {pixels.min()}")
        self._check_exposures()

    def _check_exposures(self) -> None:
        times_ms = self.exposures_ms
        if self.exposure_ms is not None and not 0.0 < self.exposure_ms < np.inf:
            raise InputError(f"dark exposure of {self.exposure_ms:g} ms; give one above 0")
        if len(times_ms) > _MOST_EXPOSURES:
            raise InputError(f"{len(times_ms)} dark exposures; give up to {_MOST_EXPOSURES}")
        if self.longer is None:
            return
        if not (self.exposure_ms or np.inf) < (self.longer.exposure_ms or 0.0):
            raise InputError(f"dark exposures of {times_ms} ms; give known and rising ones")
        if self.longer.full_scale != self.full_scale:
            raise InputError(
                f"dark frames of full scale {self.full_scale:g} and {self.longer.full_scale:g}; "
                "give frames of one depth"
            )

    @property
    def exposures(self) -> tuple[Dark, ...]:
        """Each measured exposure alone, the shortest first."""
        longer = () if self.longer is None else self.longer.exposures
        return (replace(self, longer=None), *longer)

    @property
    def exposures_ms(self) -> tuple[float | None, ...]:
        """The measured exposures, the shortest first."""
        longer = () if self.longer is None else self.longer.exposures_ms
        return (self.exposure_ms, *longer)

    def holds_at(self, exposure_ms: float | None) -> bool:
        """Whether an exposure lies within the measured ones; True for one if either is unknown."""
        shortest_ms, longest_ms = self.exposures_ms[0], self.exposures_ms[-1]
        if shortest_ms is None or longest_ms is None or exposure_ms is None:
            return self.longer is None
        rounding = 1.0 + SAME_EXPOSURE
        return shortest_ms / rounding <= exposure_ms <= longest_ms * rounding

    def at(self, exposure_ms: float | None) -> Dark:
        """Interpolate offset, noise variance and hot pixels to one exposure, linearly."""
        if not self.holds_at(exposure_ms):
            if exposure_ms is None:
                raise InputError(
                    f"dark frames {measured_at(self)}, and the images state no exposure; use a "
                    "calibration with one dark exposure"
                )
            raise InputError(
                f"dark frames {measured_at(self)}, not at {exposure_ms:g} ms; ps4rig calibrate "
                "dark at that exposure adds it"
            )
        if self.longer is None or exposure_ms is None:
            return replace(self, longer=None)
        exposures = self.exposures
        for dark in exposures:
            if dark.exposure_ms and abs(exposure_ms / dark.exposure_ms - 1.0) <= SAME_EXPOSURE:
                return dark
        upper = next(
            k for k, dark in enumerate(exposures) if (dark.exposure_ms or 0.0) > exposure_ms
        )
        below, above = exposures[upper - 1], exposures[upper]
        assert below.exposure_ms is not None
        assert above.exposure_ms is not None
        span_ms = above.exposure_ms - below.exposure_ms
        share = (exposure_ms - below.exposure_ms) / span_ms

        def between(lower: float, higher: float) -> float:
            return lower + share * (higher - lower)

        ambient = None
        if below.ambient is not None and above.ambient is not None:
            ambient = between(below.ambient, above.ambient)
        return Dark(
            offset=between(below.offset, above.offset),
            noise=math.sqrt(between(below.noise**2, above.noise**2)),
            hot_pixels=np.unique(np.concatenate([below.hot_pixels, above.hot_pixels]), axis=0),
            ambient=ambient,
            full_scale=self.full_scale,
            exposure_ms=exposure_ms,
        )

    def added(self, other: Dark) -> Dark:
        """Return this with another exposure, which replaces an equal one."""
        same = other.holds_at
        exposures = [
            *(dark for dark in self.exposures if not same(dark.exposure_ms)),
            other,
        ]
        exposures.sort(key=lambda dark: dark.exposure_ms or 0.0, reverse=True)
        merged, *shorter = exposures
        for dark in shorter:
            merged = replace(dark, longer=merged)
        return merged


def measured_at(dark: Dark) -> str:
    """Describe the measured exposures, for messages."""
    times = [f"{time_ms:g}" for time_ms in dark.exposures_ms if time_ms is not None]
    if len(times) < 2:
        return f"were measured at {times[0]} ms only" if times else "were measured"
    return f"were measured from {times[0]} to {times[-1]} ms"
