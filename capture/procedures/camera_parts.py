"""The parts of a calibration that describe the camera, with records of their quality."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from capture.calibration.ps4cal import MeasuredPart, stated_error
from capture.calibration.setting import Setting
from capture.sets.captured_set import CapturedSet
from capture.sets.photographs import Photographs
from classify import Calibration
from classify.base.errors import CalibrationRejected, InputError
from classify.calibration.dark import Dark, DarkFrames
from classify.calibration.exposure_ladder import ExposureLadder, response_of
from classify.calibration.photon_transfer import (
    BlockLevels,
    Frames,
    PhotonTransfer,
    block_levels,
    photon_transfer,
)

# Below this standard deviation, rounding hides the noise of a pixel (0.24 DN^2 in EMVA 1288).
_MIN_NOISE_DN = 0.49
# Share of full scale of the brightest parts at the exposure that `ps4rig rig doctor` suggests.
_BRIGHT_SHARE = 0.8


@dataclass(frozen=True, eq=False)
class Rung:
    """One step of an exposure ladder: the blocks of a scene at one exposure."""

    exposure_ms: float
    levels: BlockLevels


def dark_part(
    measured: DarkFrames, dark: Dark, setting: Setting, source: Sequence[str]
) -> MeasuredPart:
    """Make the part of a calibration from frames with the lens covered."""
    dark = replace(dark, exposure_ms=setting.exposure_ms)
    full_scale = dark.full_scale
    hot = len(dark.hot_pixels)
    quality = (
        f"The camera shows {dark.offset:.4g} of {full_scale:g} in the dark, with a noise of "
        f"{dark.noise:.3g} from frame to frame and {hot} hot pixel{'' if hot == 1 else 's'}."
    )
    if dark.ambient is not None:
        quality += f" Ambient light adds {dark.ambient / full_scale:.2%} of full scale."
    figures = {
        "offset_dn": dark.offset,
        "noise_dn": dark.noise,
        "hot_pixels": float(hot),
        "fixed_pattern_dn": measured.fixed_pattern,
        "share_at_0": measured.clipped,
        "frames": float(measured.frames),
    }
    if dark.ambient is not None:
        figures["ambient_dn"] = dark.ambient
    warnings = []
    if measured.is_clipped:
        warnings.append(
            f"{measured.clipped:.0%} of the values are 0: the camera cuts its noise off, so that "
            "its offset is lower and its noise larger than measured; raise its black level or "
            "brightness control if it has one"
        )
    elif dark.noise < _MIN_NOISE_DN:
        warnings.append(
            f"rounding hides the noise ({dark.noise:.2g} in pixel values); a format with more bits "
            "would show it"
        )
    return MeasuredPart.now("dark", dark, setting, quality, figures, source, warnings)


def response_parts(
    rungs: Sequence[Rung],
    calibration: Calibration,
    setting: Setting,
    source: Sequence[str],
) -> list[MeasuredPart]:
    """Fit the response, and for a linear camera the noise, to a ladder of exposures."""
    if not rungs:
        raise InputError("no exposures are given; give at least one set")
    full_scale = (1 << setting.bit_depth) - 1
    values = np.stack([rung.levels.means for rung in rungs])
    ladder = response_of(values, np.array([rung.exposure_ms for rung in rungs]), full_scale)
    exposures = len({rung.exposure_ms for rung in rungs})
    noise: PhotonTransfer | None = None
    try:
        if not ladder.response.linear:
            raise CalibrationRejected("photon transfer needs a linear camera")
        black_level, dark_noise = ladder.offset, None
        if calibration.dark is not None:
            scale = full_scale / calibration.dark.full_scale
            black_level, dark_noise = (
                scale * level for level in (calibration.dark.offset, calibration.dark.noise)
            )
        noise = photon_transfer(
            [rung.levels for rung in rungs], black_level, full_scale, dark_noise
        )
        warnings = []
    except CalibrationRejected as cause:
        warnings = [f"gain and read noise are left out: {cause}"]
    parts = [_response(ladder, exposures, full_scale, setting, source, warnings)]
    return parts if noise is None else [*parts, _noise(noise, setting, source)]


def levels_of(
    frames: Frames, full_scale: float, bit_depth: int, calibration: Calibration
) -> BlockLevels:
    """Levels of frames in values of the camera, without its hot pixels."""
    dark = calibration.dark
    hot = [] if dark is None else [exposure.hot_pixels for exposure in dark.exposures]
    hot_pixels_fit = bool(hot) and not any((exposure >= frames.shape[1:]).any() for exposure in hot)
    hot_pixels = np.unique(np.concatenate(hot), axis=0) if hot_pixels_fit else None
    levels = block_levels(frames, full_scale, hot_pixels)
    stretch = full_scale / ((1 << bit_depth) - 1)
    return replace(levels, means=levels.means / stretch, variances=levels.variances / stretch**2)


def response_of_photographs(
    photographs: Photographs,
    exposures_ms: Sequence[float],
    calibration: Calibration,
    source: Sequence[str],
    *,
    are_marked: bool,
) -> list[MeasuredPart]:
    """Fit the response to photographs of one still scene.

    If the exposures `are_marked` ones, those of EXIF data, the nominal exposures are tried too: a
    camera marks 1/64 s as 1/60 s (Debevec and Malik 1997).
    """
    full_scale, bit_depth = photographs.full_scale, photographs.bit_depth
    planes_at: dict[float, list[npt.NDArray[np.uint16]]] = {}
    for plane, exposure_ms in zip(photographs.planes, exposures_ms, strict=True):
        planes_at.setdefault(exposure_ms, []).append(plane)
    rungs = [
        Rung(exposure_ms, levels_of(np.stack(planes), full_scale, bit_depth, calibration))
        for exposure_ms, planes in planes_at.items()
    ]
    shape = photographs.planes[0].shape
    setting = Setting.of_photographs(shape, bit_depth, photographs.gamma)
    try:
        return response_parts(rungs, calibration, setting, source)
    except CalibrationRejected:
        if are_marked:
            with suppress(CalibrationRejected):
                nominal_rungs = [
                    replace(rung, exposure_ms=_nominal_exposure_ms(rung.exposure_ms))
                    for rung in rungs
                ]
                return response_parts(nominal_rungs, calibration, setting, source)
        raise


def _nominal_exposure_ms(exposure_ms: float) -> float:
    """The nearest exposure that is a whole number of thirds of a stop from one second."""
    return float(1e3 * 2.0 ** (round(3.0 * np.log2(exposure_ms / 1e3)) / 3.0))


def rungs_of_sets(sets: Sequence[CapturedSet], calibration: Calibration) -> list[Rung]:
    """Levels of the brightest light of sets of one still scene, by exposure."""
    first = sets[0].setting
    light = int(np.argmax([image.mean() for image in sets[0].images]))
    images: dict[tuple[float, int], list[npt.NDArray[np.uint16]]] = {}
    for captured in sets:
        camera, full_scale = captured.metadata.camera, captured.metadata.full_scale
        if camera is None:
            raise InputError(
                "a set of photographs does not state its exposure; give the photographs "
                "themselves, one for each exposure"
            )
        if differences := first.differences(captured.setting, "response"):
            raise InputError(f"the sets differ: {'; '.join(differences)}")
        images.setdefault((camera.exposure_ms, full_scale), []).append(captured.images[light])
    bit_depth = first.bit_depth
    rungs = []
    for (exposure_ms, full_scale), repeats in images.items():
        # An average of frames has less noise than the camera.
        averaged = full_scale != (1 << bit_depth) - 1
        series = [image[None] for image in repeats] if averaged else [np.stack(repeats)]
        rungs += [
            Rung(exposure_ms, levels_of(frames, full_scale, bit_depth, calibration))
            for frames in series
        ]
    return rungs


def _response(
    ladder: ExposureLadder,
    exposures: int,
    full_scale: float,
    setting: Setting,
    source: Sequence[str],
    warnings: Sequence[str],
) -> MeasuredPart:
    response, percent = ladder.response, 0.01 * full_scale
    if not response.linear and ladder.highest < _BRIGHT_SHARE * full_scale:
        extrapolation = (
            f"no level above {ladder.highest / percent:.0f} % of full scale was seen, where the "
            "curve is extrapolated: keep images below, or measure it with longer exposures or a "
            "wider aperture"
        )
        warnings = [*warnings, extrapolation]
    if response.linear:
        quality = (
            f"The camera is linear: within {stated_error(ladder.departure, 2)} of full scale "
            f"from {ladder.lowest / percent:.0f} to {ladder.highest / percent:.0f}%. Nothing is "
            "corrected."
        )
    else:
        quality = (
            f"The camera is not linear: it departs by {ladder.departure:.1%} of full scale. Pixel "
            f"values are made linear in light by a curve that explains {exposures} exposures to "
            f"{stated_error(response.error, 2)} of full scale."
        )
    figures = {
        "departure_share": ladder.departure,
        "error_share": response.error,
        "lowest_dn": ladder.lowest,
        "highest_dn": ladder.highest,
        "offset_dn": ladder.offset,
        "exposures": float(exposures),
    }
    return MeasuredPart.now("response", response, setting, quality, figures, source, warnings)


def _noise(transfer: PhotonTransfer, setting: Setting, source: Sequence[str]) -> MeasuredPart:
    sensor = transfer.noise.sensor
    read_error = transfer.read_noise_error_dn
    read = "" if read_error is None else f" +- {read_error:.2g}"
    quality = (
        f"{sensor.gain_e_per_dn:.4g} +- {transfer.gain_error * sensor.gain_e_per_dn:.2g} electrons "
        f"per pixel value, read noise {sensor.read_noise_dn:.3g}{read} in pixel values; the noise "
        f"agrees with shot noise to {stated_error(transfer.noise.error, 1)}."
    )
    figures = {
        "gain_e_per_dn": sensor.gain_e_per_dn,
        "gain_error_share": transfer.gain_error,
        "read_noise_dn": sensor.read_noise_dn,
        "black_level_dn": sensor.black_level_dn,
        "error_share": transfer.noise.error,
    }
    if read_error is not None:
        figures["read_noise_error_dn"] = read_error
    return MeasuredPart.now("noise", transfer.noise, setting, quality, figures, source)
