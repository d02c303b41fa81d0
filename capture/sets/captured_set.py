"""`CapturedSet`: the images of one surface under each light, with their metadata.

`LoadedSet` is a captured set with its calibration.
"""

from __future__ import annotations

import operator
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt

from capture.calibration.lookup import (
    FoundCalibration,
    check_setting,
    find_calibration,
    keep_beside,
)
from capture.calibration.ps4cal import CalibrationFile
from capture.calibration.setting import Setting
from capture.sets import ome_tiff
from classify import Calibration, Lighting, Method, SensorNoise, SurfaceEstimate, photometric_stereo
from classify.base.arrays import BoolArray
from classify.base.errors import InputError
from classify.images import ImageStack

from .metadata import SetMetadata, image_noise

_REMEDY = "pass another one as calibration=, or raw=True for none"


@dataclass(frozen=True, eq=False)
class CapturedSet:
    """The images of one surface under each light, with their ambient image and metadata.

    Attributes
    ----------
    images
        (N, H, W) uint16 light images in the order of the lighting; pixel values of the camera.
    ambient
        (H, W) uint16 image with all LEDs off, or None.
    mask
        (H, W) bool, false outside the part, where no pixel is valid; None for the whole frame.
    path, calibration
        File that the set was loaded from, and the calibration that it was captured with; None for a
        set from elsewhere. A file of a set holds neither.

    Raises
    ------
    InputError
        If shapes or dtypes differ from these.
    """

    images: npt.NDArray[np.uint16]
    ambient: npt.NDArray[np.uint16] | None
    metadata: SetMetadata
    mask: BoolArray | None = None
    path: Path | None = field(default=None, repr=False)
    calibration: CalibrationFile | None = field(default=None, repr=False)
    # Images, ambient image and mask whose hash is in the metadata; empty if unknown.
    hashed: tuple[object, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        lights = len(self.metadata.lighting.directions)
        if self.images.ndim != 3 or self.images.dtype != np.uint16 or len(self.images) != lights:
            raise InputError(
                f"a set of {lights} lights needs ({lights}, rows, columns) uint16 images, "
                f"not {self.images.shape} {self.images.dtype}"
            )
        shape = self.images.shape[1:]
        for name, plane, dtype in (
            ("ambient image", self.ambient, "uint16"),
            ("mask", self.mask, "bool"),
        ):
            if plane is not None and (plane.shape != shape or plane.dtype != dtype):
                raise InputError(
                    f"the {name} is {plane.shape} {plane.dtype}, the light images are {shape}; "
                    f"give {dtype} of that shape"
                )
        if (self.mask is None) != (self.metadata.mask_file is None):
            has = "no mask" if self.mask is None else "a mask"
            raise InputError(
                f"the set has {has}, but mask_file in its metadata is {self.metadata.mask_file!r}"
            )

    @property
    def label(self) -> str | None:
        """Class of the part, None if unknown."""
        return self.metadata.label

    @property
    def lighting(self) -> Lighting:
        """The lights of the images."""
        return self.metadata.lighting.to_lighting()

    @property
    def setting(self) -> Setting:
        """The setting of rig and camera that a calibration of the set must have."""
        return _setting_of(self.metadata, self.images.shape[1:])

    def with_calibration(self, file: CalibrationFile) -> CapturedSet:
        """Return the set with a calibration, which its metadata name.

        Raises
        ------
        CalibrationError
            If the calibration is of another rig or setting.
        """
        check_setting(file, self.setting, "these images")
        fields: dict[str, object] = {"calibration_ids": (file.hash,)}
        if file.calibration.mm_per_px is not None:
            fields["mm_per_px"] = file.calibration.mm_per_px
        return replace(self, metadata=self.metadata.model_copy(update=fields), calibration=file)

    def solve(
        self,
        method: Method | None = None,
        *,
        planar: bool = False,
        calibration: Calibration | None = None,
        raw: bool = False,
        uncertainty: bool = False,
        on_progress: Callable[[float], None] | None = None,
    ) -> SurfaceEstimate:
        """Solve for gradients and albedo, with ambient light subtracted.

        See `classify.photometric_stereo`. The default method is ps4_robust for four lights, else
        least_squares. No pixel outside the mask is valid. The images are corrected and
        divided by the flat field of the calibration, and its lights and noise are used.

        Parameters
        ----------
        calibration
            Calibration of this rig; by default the one that the set was captured with, or the one
            that it names, which is looked for as by ``ps4rig solve``.
        raw
            Use no calibration.
        uncertainty
            Add the standard deviations of slopes, albedo and normals.

        Raises
        ------
        CalibrationError
            If the calibration that the set names is missing, or of another rig or setting.
        InputError
            For a method that does not suit the lights.
        """
        if calibration is not None and raw:
            raise InputError("a calibration and raw=True exclude each other; give one of them")
        applied = Calibration() if raw else calibration or self._named_calibration()
        applied = applied.at(self.setting.exposure_ms)
        full_scale = self.metadata.full_scale
        stack = applied.corrected(ImageStack(self.images, self.ambient), full_scale)
        return photometric_stereo(
            stack.images, applied.lighting_of(self.lighting), method, ambient=stack.ambient,
            full_scale=full_scale, noise=self.noise_with(applied), planar=planar,
            mask=None if self.mask is None else applied.corrected_mask(self.mask),
            flat_field=applied.flat_field, uncertainty=uncertainty, on_progress=on_progress,
            lobe_exponent=None if applied.lights is None else applied.lights.lobe_exponent,
        )  # fmt: skip

    def _named_calibration(self) -> Calibration:
        file = self.calibration
        if file is not None and file.hash in self.metadata.calibration_ids:
            return file.calibration
        path = self.path or Path("a set without a file")
        calibration = calibration_of(path, self.metadata, self.images.shape[1:], remedy=_REMEDY)
        if calibration is None:
            return Calibration()
        for text in calibration.warnings:
            warnings.warn(f"{path}: {text}", stacklevel=3)
        return calibration.file.calibration

    @property
    def noise(self) -> SensorNoise | None:
        """Noise of the images; None if the camera's gain or read noise is unknown."""
        return self.noise_with(Calibration())

    def noise_with(self, calibration: Calibration) -> SensorNoise | None:
        """Noise of the images as a calibration corrects them; None if it is unknown."""
        metadata = self.metadata
        camera = metadata.camera
        sensor = None if camera is None else camera.noise
        if calibration.noise is not None:
            sensor = calibration.noise.sensor
        frames = max((len(image.frames) for image in metadata.images), default=1) or 1
        noise = image_noise(sensor, metadata.bit_depth, metadata.full_scale, frames)
        at_exposure = calibration.at(None if camera is None else camera.exposure_ms)
        return at_exposure.noise_of(noise, has_ambient=self.ambient is not None)

    def save(self, path: str | Path, *, home: Path | None = None) -> None:
        """Write an ``.ome.tif``, whole or not at all; an existing file is replaced.

        A copy of `calibration` is kept beside the file, in ``calibration/``. The temporary file is
        in `home`, a folder of the same file system, by default beside the file; see `durable_file`.

        Raises
        ------
        InputError
            If the name does not end in ``.ome.tif``, or the file cannot be written.
        """
        if self.calibration is not None:
            keep_beside(self.calibration, Path(path))
        planes = self.images, self.ambient, self.mask
        is_hashed = len(self.hashed) == len(planes) and all(map(operator.is_, self.hashed, planes))
        ome_tiff.write(
            Path(path), self.images, self.ambient, self.metadata, self.mask, home,
            is_hashed=is_hashed,
        )  # fmt: skip

    @staticmethod
    def load(path: str | Path) -> CapturedSet:
        """Read an ``.ome.tif``.

        Raises
        ------
        InputError
            If the file is missing, truncated, changed since it was written, not a captured set, or
            of another version.
        """
        path = Path(path)
        return CapturedSet(*ome_tiff.read(path), path=path)


def calibration_of(
    path: Path,
    metadata: SetMetadata,
    shape: tuple[int, ...],
    chosen: Path | None = None,
    remedy: str = "give --calibration CAL (solve, compare and export can leave it out with --raw)",
) -> FoundCalibration | None:
    """Find the calibration of the set at `path` with images of `shape`; see `find_calibration`."""
    ids, setting = metadata.calibration_ids, _setting_of(metadata, shape)
    capture_date = metadata.capture_date or metadata.created_utc
    return find_calibration(path, ids, setting, capture_date, chosen, remedy)


def _setting_of(metadata: SetMetadata, shape: tuple[int, ...]) -> Setting:
    """Return the setting of a captured or imported set with images of `shape` (rows, columns)."""
    camera = metadata.camera
    name = None if camera is None or camera.kind == "replay" else f"{camera.kind} {camera.name}"
    lit = [record for record in metadata.images if record.light is not None]
    intensities, checks = np.array(metadata.lighting.intensities), metadata.checks
    if checks is not None and checks.levels_corrected:
        intensities /= checks.light_levels
    return Setting(
        simulated=metadata.simulated,
        rig_name=metadata.rig_name,
        camera=name,
        width_px=shape[1],
        height_px=shape[0],
        crop=metadata.crop,
        bit_depth=metadata.bit_depth,
        exposure_ms=None if camera is None else camera.exposure_ms,
        gain=None if camera is None else camera.gain,
        gamma=None if camera is None else camera.gamma,
        pixel_value_controls={} if camera is None else camera.pixel_value_controls,
        photograph_gamma=metadata.gamma,
        light_directions=metadata.lighting.directions,
        light_intensities=tuple(intensities.tolist()),
        led_levels_percent=tuple(record.led_level_percent for record in lit),
    )


# Training sets are solved as planar parts. This removes the fall-off of near lights; a texture has
# no tilt or bow that it could remove too.
PLANAR = True


@dataclass(frozen=True, eq=False)
class LoadedSet:
    """A captured set with its calibration, if it has one."""

    captured: CapturedSet
    found_calibration: FoundCalibration | None

    @classmethod
    def of(cls, path: Path, calibration: Path | None = None, *, raw: bool = False) -> Self:
        """Load a set with `calibration`, by default the one that it names; with none if `raw`."""
        captured = CapturedSet.load(path)
        metadata, shape = captured.metadata, captured.images.shape[1:]
        return cls(captured, None if raw else calibration_of(path, metadata, shape, calibration))

    @property
    def calibration(self) -> Calibration | None:
        """The calibration of the rig; None without one."""
        return None if self.found_calibration is None else self.found_calibration.file.calibration

    @property
    def mm_per_px(self) -> float | None:
        """Scale of the calibration in use, else the one given at import; None if it is unknown."""
        if self.calibration is not None and self.calibration.mm_per_px is not None:
            return self.calibration.mm_per_px
        metadata, in_use = self.captured.metadata, self.found_calibration
        # A set that names a calibration may have its scale from it.
        is_named = in_use is not None and in_use.file.hash in metadata.calibration_ids
        return metadata.mm_per_px if is_named or not metadata.calibration_ids else None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the calibration."""
        return () if self.found_calibration is None else self.found_calibration.warnings

    def solve_texture(
        self, method: Method | None, *, planar: bool, uncertainty: bool = False
    ) -> SurfaceEstimate:
        """Solve a part with a texture.

        If the part is planar, its fall-off is fitted unless the calibration has a flat field.
        """
        has_flat_field = self.calibration is not None and self.calibration.flat_field is not None
        return self.solve(method, planar=planar and not has_flat_field, uncertainty=uncertainty)

    def solve(
        self,
        method: Method | None = None,
        *,
        planar: bool = False,
        uncertainty: bool = False,
        on_progress: Callable[[float], None] | None = None,
    ) -> SurfaceEstimate:
        """Solve with this calibration, or raw without one; see `CapturedSet.solve`."""
        calibration = self.calibration
        return self.captured.solve(
            method, planar=planar, calibration=calibration, raw=calibration is None,
            uncertainty=uncertainty, on_progress=on_progress,
        )  # fmt: skip


@contextmanager
def naming_file(path: Path) -> Iterator[None]:
    """Put the name of the file in front of the message of an `InputError`."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
