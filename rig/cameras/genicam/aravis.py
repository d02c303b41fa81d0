"""`AravisCamera`: features and buffers of one camera, through the library Aravis 0.8.

Aravis speaks GigE Vision and USB3 Vision itself, so that no maker's driver is needed.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

from rig.cameras.camera import ListedCamera
from rig.errors import CameraError

FRAMES_IN_SOCKET = 2
"""Frames that the kernel may hold for this program, if net.core.rmem_max allows so many bytes."""
_CONTROL_TIMEOUT_S = 3.0  # for a program that has the camera open while it lists it
FRAME_ID_COUNT = 65_535
"""Number of frame ids of GigE Vision 1: 16 bits, of which 0 is not used."""


@cache
def aravis() -> Any:
    """The module of Aravis; raises `CameraError` if it is not installed."""
    try:
        import gi

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis
    except (ImportError, ValueError) as error:
        raise CameraError(
            f"camera.kind = 'genicam' needs PyGObject and Aravis ({error}): pip install "
            "'ps4rig[genicam]', and sudo apt install gir1.2-aravis-0.8"
        ) from error
    return Aravis


def _call(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function of Aravis; raise `CameraError` with its error message."""
    from gi.repository import GLib

    try:
        return function(*arguments)
    except GLib.Error as error:
        raise CameraError(error.message) from error


def find_devices() -> list[ListedCamera]:
    """Search networks and USB for half a second, without opening a camera."""
    library = aravis()
    library.update_device_list()
    return [
        ListedCamera(
            "genicam",
            device=library.get_device_id(index),
            name=_joined(library.get_device_vendor(index), library.get_device_model(index)),
            driver=library.get_device_protocol(index),
            names=(library.get_device_serial_nbr(index), library.get_device_address(index)),
        )
        for index in range(library.get_n_devices())
    ]


def _joined(*names: str | None) -> str:
    return " ".join(filter(None, names))


_Value = TypeVar("_Value", bool, int, float, str)
_TYPE_NAMES: dict[type, str] = {str: "string", int: "integer", float: "float", bool: "boolean"}


@dataclass(frozen=True)
class Buffer:
    """One frame as the camera sent it; an incomplete one has no data."""

    data: bytes
    size_px: tuple[int, int]
    frame_id: int
    device_ns: int  # by the camera's clock; 0 without one
    arrival_utc_ns: int  # of the first packet, by the clock of this machine


class AravisCamera:
    """An open camera; every method raises `CameraError` with the message of Aravis."""

    def __init__(self, device: str) -> None:
        self._stream: Any = None
        try:
            self._camera: Any = _call(aravis().Camera.new, device)
        except CameraError:  # Aravis takes ids and addresses
            ids = [camera.device for camera in find_devices() if device in camera.names]
            if not ids:
                raise
            self._camera = _call(aravis().Camera.new, ids[0])

    def take_control(self) -> None:
        """Let no other program change the camera; wait briefly while one lists it."""
        if not self._camera.is_gv_device():  # a USB camera opens for one program only
            return
        device, deadline_s = self._camera.get_device(), time.monotonic() + _CONTROL_TIMEOUT_S
        while not device.is_controller():
            try:
                _call(device.take_control)
            except CameraError as error:
                if time.monotonic() > deadline_s:
                    raise CameraError("another program has the camera open; close it") from error
                time.sleep(0.05)

    @property
    def name(self) -> str:
        """Maker and model."""
        camera = self._camera
        return _joined(_call(camera.get_vendor_name), _call(camera.get_model_name))

    def has(self, feature: str) -> bool:
        """Whether the camera has a feature at present."""
        return bool(_call(self._camera.is_feature_available, feature))

    def value(self, feature: str, kind: type[_Value]) -> _Value:
        """Value of a feature: a string or an enumeration, a boolean, an integer or a float."""
        value: _Value = _call(getattr(self._camera, f"get_{_TYPE_NAMES[kind]}"), feature)
        return value

    def number(self, feature: str) -> float:
        """Value of a feature that is an integer in some cameras and a float in others."""
        try:
            return self.value(feature, float)
        except CameraError:
            return float(self.value(feature, int))

    def set_value(self, feature: str, value: bool | int | float | str) -> None:
        """Set a feature of the kind of `value`."""
        _call(getattr(self._camera, f"set_{_TYPE_NAMES[type(value)]}"), feature, value)

    def entries(self, feature: str) -> list[str]:
        """Values that an enumeration takes at present."""
        return list(_call(self._camera.dup_available_enumerations_as_strings, feature))

    @property
    def frame_rate_hz(self) -> float:
        return float(_call(self._camera.get_frame_rate))

    def set_frame_rate(self, rate_hz: float) -> None:
        """Set the frame rate by the feature of this camera model."""
        _call(self._camera.set_frame_rate, rate_hz)

    @property
    def exposure_ms(self) -> float:
        """Exposure time in use."""
        return float(_call(self._camera.get_exposure_time)) / 1e3

    def set_exposure(self, exposure_ms: float) -> None:
        """Set the exposure time by the feature of this camera model."""
        _call(self._camera.set_exposure_time, 1e3 * exposure_ms)

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        """Shortest and longest exposure."""
        names = [name for name in ("ExposureTime", "ExposureTimeAbs") if self.has(name)]
        try:
            shortest_us, longest_us = _call(self._camera.get_float_bounds, *names[:1])
        except (CameraError, TypeError):  # TypeError: there is no name
            # Not the first choice, because a Basler ace returns the bounds of ExposureTimeRaw here,
            # which are not in us.
            shortest_us, longest_us = _call(self._camera.get_exposure_time_bounds)
        return shortest_us / 1e3, longest_us / 1e3

    @property
    def gain(self) -> float | None:
        """Gain in the camera's units, mostly dB; None without one."""
        if not _call(self._camera.is_gain_available):
            return None
        return float(_call(self._camera.get_gain))

    def set_gain(self, gain: float) -> None:
        """Set the gain by the feature of this camera model."""
        _call(self._camera.set_gain, gain)

    def start(self, buffers: int) -> None:
        """Start to stream into `buffers` buffers; frames are lost while all of them are full."""
        library, camera = aravis(), self._camera
        if camera.is_gv_device():
            _call(camera.gv_auto_packet_size)
            # A packet socket needs root, and receives nothing from a camera on this host.
            camera.gv_set_stream_options(library.GvStreamOption.PACKET_SOCKET_DISABLED)
        self._stream = _call(camera.create_stream)
        payload = _call(camera.get_payload)
        if camera.is_gv_device():
            # The default holds less than a frame, and loses packets while another program has the
            # processor.
            self._stream.props.socket_buffer = library.GvStreamSocketBuffer.FIXED
            self._stream.props.socket_buffer_size = FRAMES_IN_SOCKET * payload
        for _ in range(buffers):
            self._stream.push_buffer(library.Buffer.new_allocate(payload))
        _call(camera.start_acquisition)

    def next_buffer(self, timeout_s: float) -> Buffer | None:
        """Return the oldest filled buffer, or wait for one; None after the time-out."""
        if self._stream is None:
            raise CameraError("the camera is closed")
        buffer = self._stream.timeout_pop_buffer(round(1e6 * timeout_s))
        if buffer is None:
            return None
        try:
            is_complete = buffer.get_status() == aravis().BufferStatus.SUCCESS
            return Buffer(
                bytes(buffer.get_data()) if is_complete else b"",
                (buffer.get_image_width(), buffer.get_image_height()) if is_complete else (0, 0),
                buffer.get_frame_id(),
                buffer.get_timestamp(),
                buffer.get_system_timestamp(),
            )
        finally:
            self._stream.push_buffer(buffer)

    def close(self) -> None:
        """Stop streaming and release the camera; a second call does nothing."""
        if self._stream is not None:
            with suppress(CameraError):  # it was unplugged
                _call(self._camera.stop_acquisition)
        # Aravis ends each with its last reference; the stream must end before the camera.
        self._stream = None
        self._camera = None
