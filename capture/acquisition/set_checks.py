"""All checks of the images of a set, in their order."""

from collections.abc import Callable

from capture.sets.image_checks import Images, LightImages
from capture.sets.metadata import ChecksRecord
from classify.calibration.calibration import Calibration

from .light_checks import (
    check_ambient,
    check_different,
    check_images,
    check_levels,
    check_order,
    check_retake,
    check_signals,
    order_of,
    retake_reasons,
)


def check_set(
    images: LightImages, known: Calibration, retake: Callable[[], Images]
) -> ChecksRecord:
    """Check the images of a set; undecided checks call `retake` once, which captures them again."""
    calibrated = images.calibrated(known)
    ambient_change = check_ambient(images)
    check_images(images)
    check_different(images)
    agreement = calibrated.agreement()
    check_levels(agreement, calibrated)
    undecided = retake_reasons(agreement)
    if undecided:
        check_retake(images, retake())
        if agreement is None or agreement.levels is None:
            check_signals(calibrated)
    light_order = check_order(order_of(calibrated), calibrated.lighting)
    levels = None if agreement is None else agreement.levels
    return ChecksRecord(
        ambient_change=ambient_change,
        redundancy_residual=None if agreement is None else agreement.redundancy_residual,
        light_levels=levels,
        light_levels_error=None if agreement is None or levels is None else agreement.level_error,
        retaken=bool(undecided),
        light_order=light_order,
        undecided=undecided,
    )
