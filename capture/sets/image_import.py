"""Import of photographs as a captured set."""

from collections.abc import Collection, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from capture.base.errors import SetRejected
from capture.base.utc_time import utc_text
from classify import Lighting
from classify.base.errors import InputError
from classify.calibration.calibration import Calibration
from classify.lights.algebra import require_solvable
from classify.methods import checked_label
from rig.set_file import pixels_sha256

from .captured_set import CapturedSet
from .image_checks import LightImages
from .metadata import ImageRecord, LightingRecord, SetMetadata
from .photograph_checks import check_photographs
from .photographs import Crop, Gamma, Photographs, read_mask, read_photographs


def import_images(
    paths: Sequence[Path],
    lighting: Lighting,
    *,
    gamma: Gamma | None = None,
    ambient: Path | None = None,
    label: str | None = None,
    bits: int | None = None,
    mask: Path | None = None,
    crop: Crop | None = None,
    accept: Collection[str] = (),
    warnings: Sequence[str] = (),
    calibration: Calibration | None = None,
) -> CapturedSet:
    """Make a captured set from PNG, JPEG, TIFF, TGA or DNG photographs of 8 or 16 bit.

    The photographs are turned upright as their EXIF data say. Linear grey images keep their pixel
    values. All others are made linear, reduced to luminance and stored with 16 bits. A pixel with
    any channel at full scale is stored at full scale, so that the solver treats it as saturated. An
    alpha channel is ignored. `check_photographs` checks the images.

    Parameters
    ----------
    paths
        One photograph per light, in the order of `lighting`.
    gamma
        Response of the photographs, ``linear`` or ``srgb``. By default it is the one that they
        state, else ``linear``; it must be given for a JPEG that does not state it.
    ambient
        Photograph with all lights off.
    bits
        Depth of the data in the files; guessed from the largest value for files of 16 bits.
    mask
        Image of the same frame, light where the part is. No other pixel is valid.
    crop
        Column and row of the top left pixel, width and height of the part that is kept.
    accept
        Names of an `ImportCause` that is a warning instead of a refusal.
    warnings
        Warnings about the lights, to be kept in the set before those of the checks.
    calibration
        Of camera and lights, which the checks take into account.

    Raises
    ------
    InputError
        If a file is missing, damaged or of another format, sizes, depths or orientations differ,
        `gamma` is missing although it is unknown, or images under these lights cannot be solved.
    SetRejected
        If no surface explains the photographs; the message names every cause.
    """
    if label is not None:
        checked_label(label)
    if len(paths) != len(lighting):
        raise InputError(f"{len(paths)} images for {len(lighting)} lights; give one image each")
    require_solvable(lighting)
    files = [*paths, *(() if ambient is None else (ambient,))]
    photographs = read_photographs(files, gamma=gamma, bits=bits, crop=crop)
    part = (
        None if mask is None else read_mask(mask, photographs.frame, crop, photographs.orientation)
    )
    images = np.stack(photographs.planes[: len(lighting)])
    ambient_image = None if ambient is None else photographs.planes[-1]
    # Bytes of a file name that are not UTF-8 are escaped.
    names = [path.name.encode("utf-8", "backslashreplace").decode() for path in files]
    checked = LightImages(
        images=images,
        ambient=np.zeros_like(images[0]) if ambient_image is None else ambient_image,
        later_ambient=None,
        lighting=lighting,
        names=names[: len(lighting)],
        full_scale=photographs.full_scale,
        noise=None,
    )
    findings, checks = check_photographs(checked, part, (calibration or Calibration()).at(None))
    refused = [finding for finding in findings if finding.refutes and finding.cause not in accept]
    if refused:
        causes = "; ".join(f"{finding.text} (--accept {finding.cause})" for finding in refused)
        raise SetRejected(f"set rejected: {causes}")
    records = [ImageRecord(light=k, source_file=name) for k, name in enumerate(names)]
    if ambient is not None:
        records[-1] = ImageRecord(light=None, source_file=names[-1])
    metadata = SetMetadata(
        label=label,
        created_utc=utc_text(),
        simulated=False,
        bit_depth=photographs.bit_depth,
        full_scale=photographs.full_scale,
        lighting=LightingRecord.of(lighting),
        images=tuple(records),
        checks=checks,
        gamma=photographs.gamma,
        gamma_source=photographs.gamma_source,
        photographed=photographs.date,
        crop=crop,
        mask_file=None if mask is None else mask.name.encode("utf-8", "backslashreplace").decode(),
        warnings=(
            *warnings,
            *photographs.warnings,
            *_about_depth(photographs),
            *(finding.text for finding in findings),
        ),
        accepted=tuple(dict.fromkeys(finding.cause for finding in findings if finding.refutes)),
        software_version=version("ps4rig"),
        pixels_sha256=pixels_sha256(images, ambient_image, part),
    )
    return CapturedSet(images, ambient_image, metadata, part)


def _about_depth(photographs: Photographs) -> list[str]:
    if photographs.largest is None or photographs.bit_depth == 16:
        return []
    text = f"the data are taken for {photographs.bit_depth} bits, because the largest value is"
    return [f"{text} {photographs.largest}; --bits N sets another depth"]
