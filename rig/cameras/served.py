"""`ServedCamera`: a simulated rig's camera as a device of one kind, which other programs open."""

from typing import ClassVar, NamedTuple, Protocol, runtime_checkable

from .camera import Pixels
from .config import CameraConfig


class ServedFrame(NamedTuple):
    """One image, its number, and the end of its exposure and readout on the monotonic clock."""

    pixels: Pixels
    number: int
    end_s: float


class FrameSource(Protocol):
    """The simulated rig whose frames are served."""

    serial_number: str

    def next_frame(
        self, max_late_periods: float, exposure_ms: float | None = None
    ) -> ServedFrame | None:
        """Wait for a frame; None if it is late by more than `max_late_periods` periods.

        `exposure_ms` is that of the device, None for one without such a control.
        """


class ServedCamera(Protocol):
    """A camera at `place`; raises `ConfigError` for a configuration that it cannot serve."""

    place_help: ClassVar[str]  # the form of a place, for the help of `rig simulate`
    pixel_format: str
    bit_depth: int

    def __init__(self, place: str, config: CameraConfig) -> None: ...

    def start(self, source: FrameSource) -> None:
        """Create the device."""

    def step(self) -> None:
        """Serve a frame, or wait for a frame period if another thread serves them."""

    def close(self) -> None:
        """Remove the device; a second call does nothing."""


@runtime_checkable
class TriggeredCamera(ServedCamera, Protocol):
    """A served camera with a trigger input."""

    def trigger(self) -> None:
        """Give a pulse on the trigger line."""
