"""The table of the kinds of camera; code that depends on the kind reads its row."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from pydantic import ValidationError

from classify.base.models import explained, toml_text, validation_message
from rig.errors import CameraFault

from .camera import Camera, CameraInfo, ListedCamera
from .config import CameraConfig, ReplayCameraConfig, SimulatedCameraConfig
from .genicam.camera import GenicamCamera, list_genicam_cameras, network_faults
from .genicam.fake import FakeGigeCamera
from .genicam.measurement_mode import GenicamCameraConfig
from .opencv import OpencvCamera, OpencvCameraConfig
from .served import ServedCamera
from .v4l2.camera import V4l2Camera, list_v4l2_cameras
from .v4l2.measurement_mode import V4l2CameraConfig
from .v4l2.output import LoopbackCamera

_Config = TypeVar("_Config", bound=CameraConfig)


@dataclass(frozen=True)
class CameraKind(Generic[_Config]):
    """One kind of camera."""

    # Keys of [camera] with the types of its exposure, gain and gamma. A camera that stamps its
    # frames has a `StampedCameraConfig`; a device, a `DeviceCameraConfig`, by which `doctor` finds
    # it among the listed ones.
    config: type[_Config]
    # None: the simulated rig has this camera.
    opener: Callable[[_Config], Camera] | None = None
    # For `rig init` and `doctor`; None for cameras that another kind lists.
    lister: Callable[[], list[ListedCamera]] | None = None
    # Device classes and groups that the unit of a station needs.
    device_classes: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()
    # What `doctor` warns of when the camera is open.
    faults: Callable[[CameraInfo], Iterator[CameraFault]] | None = None
    # The device that `rig simulate` serves.
    served: type[ServedCamera] | None = None


CAMERA_KINDS: dict[str, CameraKind[Any]] = {
    "simulated": CameraKind(SimulatedCameraConfig),
    "v4l2": CameraKind(
        V4l2CameraConfig,
        V4l2Camera,
        list_v4l2_cameras,
        device_classes=("char-video4linux",),
        groups=("video",),
        served=LoopbackCamera,
    ),
    "opencv": CameraKind(
        OpencvCameraConfig,
        OpencvCamera,
        device_classes=("char-video4linux",),
        groups=("video",),
    ),
    "genicam": CameraKind(
        GenicamCameraConfig,
        GenicamCamera,
        list_genicam_cameras,
        device_classes=("char-usb_device",),
        groups=("video",),
        faults=network_faults,
        served=FakeGigeCamera,
    ),
    "replay": CameraKind(ReplayCameraConfig),
}


def list_cameras() -> list[ListedCamera]:
    """List the cameras of this machine, kind by kind, without claiming any."""
    listers = [kind.lister for kind in CAMERA_KINDS.values() if kind.lister is not None]
    return [camera for lister in listers for camera in lister()]


def camera_config(values: Any) -> Any:
    """Validate the section [camera] as that of its kind.

    Keys of other kinds are dropped if they have their default, so that a file may list every key.
    """
    if not isinstance(values, dict):
        return values
    kind = CAMERA_KINDS.get(str(values.get("kind")))
    if kind is None:
        kinds = ", ".join(map(repr, CAMERA_KINDS))
        raise explained(f"camera.kind = {toml_text(values.get('kind'))}: must be one of {kinds}")
    own_values = {}
    for key, value in values.items():
        defaults = {
            name: camera_kind.config.model_fields[key].default
            for name, camera_kind in CAMERA_KINDS.items()
            if key in camera_kind.config.model_fields
        }
        if key in kind.config.model_fields or not defaults:
            own_values[key] = value
        elif value not in defaults.values():
            kinds = " or ".join(map(repr, defaults))
            raise explained(
                f"camera.{key} = {toml_text(value)}: not a key of kind = {values['kind']!r}; leave "
                f"it out, or set kind = {kinds}"
            )
    try:
        return kind.config.model_validate(own_values)
    except ValidationError as error:
        raise explained(validation_message(error, kind.config, "camera")) from error
