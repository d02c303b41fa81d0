"""A rig whose frames are changed before a program reads them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from rig import Camera, CameraInfo, Frame, Rig


@dataclass
class _ChangedCamera:
    camera: Camera
    change: Callable[[Frame], Frame | None]

    @property
    def info(self) -> CameraInfo:
        return self.camera.info

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        return self.camera.exposure_range_ms

    def set_exposure(self, exposure_ms: float) -> None:
        self.camera.set_exposure(exposure_ms)

    def read(self, timeout_s: float) -> Frame:
        while (frame := self.change(self.camera.read(timeout_s))) is None:
            pass
        return frame

    def close(self) -> None:
        self.camera.close()


def with_frames(rig: Rig, change: Callable[[Frame], Frame | None]) -> Rig:
    """The rig with each frame replaced by `change` of it; None drops a frame."""
    return replace(rig, camera=_ChangedCamera(rig.camera, change))
