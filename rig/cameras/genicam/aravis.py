"""`AravisCamera`: features and buffers of one camera, by Aravis 0.8, the C library.

Aravis speaks GigE Vision and USB3 Vision itself, so that no maker's driver is needed. Its Python
bindings come through GObject introspection, which pip cannot install without a compiler.
"""

import ctypes
from collections.abc import Callable
from ctypes import (
    POINTER,
    byref,
    c_char_p,
    c_double,
    c_int,
    c_int64,
    c_size_t,
    c_uint,
    c_uint32,
    c_uint64,
    c_void_p,
)
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

from rig.errors import CameraError

FRAME_ID_COUNT = 65_535
"""Number of frame ids of GigE Vision 1: 16 bits, of which 0 is not used."""

LIBRARY = "libaravis-0.8.so.0"
_SUCCESS = 0  # of ArvBufferStatus
# Of ArvGvStreamOption. A packet socket needs root, and receives nothing from a camera on this host.
_NO_PACKET_SOCKET = 1
# Names of ArvBufferStatus.
_STATUSES = {
    1: "cleared", 2: "time-out", 3: "missing packets", 4: "wrong packet id", 5: "size mismatch",
    6: "filling", 7: "aborted", 8: "payload not supported",
}  # fmt: skip


class _GError(ctypes.Structure):
    _fields_ = (("domain", ctypes.c_uint32), ("code", c_int), ("message", c_char_p))


# Result type, parameter types, and whether a last parameter, GError**, receives an error.
_FUNCTIONS: dict[str, tuple[Any, tuple[Any, ...], bool]] = {
    "arv_update_device_list": (None, (), False),
    "arv_get_n_devices": (c_uint, (), False),
    "arv_get_device_id": (c_char_p, (c_uint,), False),
    "arv_get_device_model": (c_char_p, (c_uint,), False),
    "arv_get_device_vendor": (c_char_p, (c_uint,), False),
    "arv_get_device_protocol": (c_char_p, (c_uint,), False),
    "arv_camera_new": (c_void_p, (c_char_p,), True),
    "arv_camera_get_device": (c_void_p, (c_void_p,), False),
    "arv_camera_get_vendor_name": (c_char_p, (c_void_p,), True),
    "arv_camera_get_model_name": (c_char_p, (c_void_p,), True),
    "arv_camera_is_gv_device": (c_int, (c_void_p,), False),
    "arv_camera_gv_auto_packet_size": (c_uint, (c_void_p,), True),
    "arv_camera_gv_set_stream_options": (None, (c_void_p, c_int), False),
    "arv_camera_set_frame_rate": (None, (c_void_p, c_double), True),
    "arv_camera_get_frame_rate": (c_double, (c_void_p,), True),
    "arv_camera_set_exposure_time": (None, (c_void_p, c_double), True),
    "arv_camera_get_exposure_time": (c_double, (c_void_p,), True),
    "arv_camera_get_exposure_time_bounds": (
        None, (c_void_p, POINTER(c_double), POINTER(c_double)), True
    ),
    "arv_camera_is_gain_available": (c_int, (c_void_p,), True),
    "arv_camera_set_gain": (None, (c_void_p, c_double), True),
    "arv_camera_get_gain": (c_double, (c_void_p,), True),
    "arv_camera_get_payload": (c_uint, (c_void_p,), True),
    "arv_camera_create_stream": (c_void_p, (c_void_p, c_void_p, c_void_p), True),
    "arv_camera_start_acquisition": (None, (c_void_p,), True),
    "arv_camera_stop_acquisition": (None, (c_void_p,), True),
    "arv_device_is_feature_available": (c_int, (c_void_p, c_char_p), True),
    "arv_device_get_string_feature_value": (c_char_p, (c_void_p, c_char_p), True),
    "arv_device_set_string_feature_value": (None, (c_void_p, c_char_p, c_char_p), True),
    "arv_device_get_integer_feature_value": (c_int64, (c_void_p, c_char_p), True),
    "arv_device_set_integer_feature_value": (None, (c_void_p, c_char_p, c_int64), True),
    "arv_device_get_float_feature_value": (c_double, (c_void_p, c_char_p), True),
    "arv_device_set_float_feature_value": (None, (c_void_p, c_char_p, c_double), True),
    "arv_device_is_enumeration_entry_available": (c_int, (c_void_p, c_char_p, c_char_p), True),
    "arv_device_dup_available_enumeration_feature_values_as_strings": (
        POINTER(c_char_p), (c_void_p, c_char_p, POINTER(c_uint)), True
    ),
    "arv_stream_push_buffer": (None, (c_void_p, c_void_p), False),
    "arv_stream_timeout_pop_buffer": (c_void_p, (c_void_p, c_uint64), False),
    "arv_buffer_new_allocate": (c_void_p, (c_size_t,), False),
    "arv_buffer_get_status": (c_int, (c_void_p,), False),
    "arv_buffer_get_data": (c_void_p, (c_void_p, POINTER(c_size_t)), False),
    "arv_buffer_get_image_width": (c_int, (c_void_p,), False),
    "arv_buffer_get_image_height": (c_int, (c_void_p,), False),
    "arv_buffer_get_frame_id": (c_uint64, (c_void_p,), False),
    "arv_buffer_get_timestamp": (c_uint64, (c_void_p,), False),
    "arv_buffer_get_system_timestamp": (c_uint64, (c_void_p,), False),
    "arv_buffer_set_frame_id": (None, (c_void_p, c_uint64), False),
    "arv_buffer_set_timestamp": (None, (c_void_p, c_uint64), False),
    "arv_fake_camera_new": (c_void_p, (c_char_p,), False),
    "arv_fake_camera_get_genicam_xml": (c_void_p, (c_void_p, POINTER(c_size_t)), False),
    "arv_gv_fake_camera_new_full": (c_void_p, (c_char_p, c_char_p, c_char_p), False),
    "arv_gv_fake_camera_is_running": (c_int, (c_void_p,), False),
    "arv_gv_fake_camera_get_fake_camera": (c_void_p, (c_void_p,), False),
    "arv_fake_camera_set_fill_pattern": (None, (c_void_p, c_void_p, c_void_p), False),
    "arv_fake_camera_set_trigger_frequency": (None, (c_void_p, c_double), False),
    "arv_fake_camera_write_register": (c_int, (c_void_p, c_uint32, c_uint32), False),
    # Variadic: one property of type double, then NULL, which ends the list.
    "g_object_set": (None, (c_void_p, c_char_p, c_double, c_void_p), False),
    "g_object_unref": (None, (c_void_p,), False),
    "g_error_free": (None, (c_void_p,), False),
    "g_free": (None, (c_void_p,), False),
}  # fmt: skip


@cache
def functions() -> dict[str, Callable[..., Any]]:
    try:
        library = ctypes.CDLL(LIBRARY)
    except OSError as error:
        raise CameraError(
            f"camera.kind = 'genicam' needs the library Aravis ({LIBRARY}); install it: "
            "sudo apt install libaravis-0.8-0"
        ) from error
    table: dict[str, Callable[..., Any]] = {}
    for name, (result, parameters, reports_error) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype = result
        function.argtypes = [*parameters, *((POINTER(POINTER(_GError)),) if reports_error else ())]
        table[name] = function
    return table


def is_installed() -> bool:
    """Whether the library is there."""
    try:
        functions()
    except CameraError:
        return False
    return True


def call(name: str, *arguments: Any) -> Any:
    """Call a function of Aravis; raise `CameraError` with its error message."""
    function = functions()[name]
    if not _FUNCTIONS[name][2]:
        return function(*arguments)
    error = POINTER(_GError)()
    result = function(*arguments, byref(error))
    if error:
        text = (error.contents.message or b"").decode(errors="replace")
        functions()["g_error_free"](error)
        raise CameraError(text)
    return result


@dataclass(frozen=True)
class _DetectedCamera:
    """A camera that answered the search."""

    device_id: str
    name: str
    protocol: str


def find_devices() -> list[_DetectedCamera]:
    """Search networks and USB for half a second."""
    call("arv_update_device_list")

    def text(attribute: str, index: int) -> str:
        return (call(f"arv_get_device_{attribute}", index) or b"").decode(errors="replace")

    return [
        _DetectedCamera(
            text("id", index),
            f"{text('vendor', index)} {text('model', index)}".strip(),
            text("protocol", index),
        )
        for index in range(call("arv_get_n_devices"))
    ]


_FEATURE_TYPES: dict[type, str] = {str: "string", int: "integer", float: "float"}
_Value = TypeVar("_Value", int, float, str)


@dataclass(frozen=True)
class Buffer:
    """One frame as the camera sent it; `fault` is empty for a complete one."""

    data: bytes
    size_px: tuple[int, int]
    frame_id: int
    device_ns: int  # by the camera's clock; 0 without one
    arrival_utc_ns: int  # of the first packet, by the clock of this machine
    fault: str


class AravisCamera:
    """An open camera; every method raises `CameraError` with the message of Aravis."""

    def __init__(self, device: str) -> None:
        self._stream: int | None = None
        self._camera: int | None = call("arv_camera_new", device.encode() if device else None)
        self._device = call("arv_camera_get_device", self._camera)

    @property
    def name(self) -> str:
        """Maker and model."""
        names = (call(f"arv_camera_get_{part}_name", self._camera) for part in ("vendor", "model"))
        return " ".join((name or b"").decode(errors="replace") for name in names)

    def has(self, feature: str) -> bool:
        """Whether the camera has a feature at present."""
        return bool(call("arv_device_is_feature_available", self._device, feature.encode()))

    def value(self, feature: str, kind: type[_Value]) -> _Value:
        """Value of a feature: a string or an enumeration, an integer or a float."""
        name = f"arv_device_get_{_FEATURE_TYPES[kind]}_feature_value"
        value = call(name, self._device, feature.encode())
        return kind((value or b"").decode(errors="replace") if kind is str else value)

    def set_value(self, feature: str, value: int | float | str) -> None:
        """Set a feature of the kind of `value`."""
        name = f"arv_device_set_{_FEATURE_TYPES[type(value)]}_feature_value"
        argument = value.encode() if isinstance(value, str) else value
        call(name, self._device, feature.encode(), argument)

    def entries(self, feature: str) -> list[str]:
        """Values that an enumeration takes at present."""
        count = c_uint()
        values = call(
            "arv_device_dup_available_enumeration_feature_values_as_strings",
            self._device, feature.encode(), byref(count),
        )  # fmt: skip
        if not values:
            return []
        names = [values[index].decode(errors="replace") for index in range(count.value)]
        call("g_free", ctypes.cast(values, c_void_p))
        return names

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second."""
        return float(call("arv_camera_get_frame_rate", self._camera))

    def set_frame_rate(self, rate_hz: float) -> None:
        """Set the frame rate by the feature of this camera model."""
        call("arv_camera_set_frame_rate", self._camera, rate_hz)

    @property
    def exposure_ms(self) -> float:
        """Exposure time in use."""
        return float(call("arv_camera_get_exposure_time", self._camera)) / 1e3

    def set_exposure(self, exposure_ms: float) -> None:
        """Set the exposure time by the feature of this camera model."""
        call("arv_camera_set_exposure_time", self._camera, 1e3 * exposure_ms)

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        """Shortest and longest exposure."""
        shortest_us, longest_us = c_double(), c_double()
        call(
            "arv_camera_get_exposure_time_bounds",
            self._camera, byref(shortest_us), byref(longest_us),
        )  # fmt: skip
        return shortest_us.value / 1e3, longest_us.value / 1e3

    @property
    def gain(self) -> float | None:
        """Gain in the camera's units, mostly dB; None without one."""
        if not call("arv_camera_is_gain_available", self._camera):
            return None
        return float(call("arv_camera_get_gain", self._camera))

    def set_gain(self, gain: float) -> None:
        """Set the gain by the feature of this camera model."""
        call("arv_camera_set_gain", self._camera, gain)

    def start(self, buffers: int) -> None:
        """Start to stream into `buffers` buffers; frames are lost while all of them are full."""
        if call("arv_camera_is_gv_device", self._camera):
            call("arv_camera_gv_auto_packet_size", self._camera)
            call("arv_camera_gv_set_stream_options", self._camera, _NO_PACKET_SOCKET)
        self._stream = call("arv_camera_create_stream", self._camera, None, None)
        payload = call("arv_camera_get_payload", self._camera)
        for _ in range(buffers):
            call("arv_stream_push_buffer", self._stream, call("arv_buffer_new_allocate", payload))
        call("arv_camera_start_acquisition", self._camera)

    def next_buffer(self, timeout_s: float) -> Buffer | None:
        """Return the oldest filled buffer, or wait for one; None after the time-out."""
        if self._camera is None:
            raise CameraError("the camera is closed")
        buffer = call("arv_stream_timeout_pop_buffer", self._stream, round(1e6 * timeout_s))
        if not buffer:
            return None
        try:
            status, size = call("arv_buffer_get_status", buffer), c_size_t()
            data = call("arv_buffer_get_data", buffer, byref(size))
            is_complete = status == _SUCCESS
            return Buffer(
                ctypes.string_at(data, size.value) if is_complete else b"",
                (
                    call("arv_buffer_get_image_width", buffer),
                    call("arv_buffer_get_image_height", buffer),
                )
                if is_complete
                else (0, 0),
                call("arv_buffer_get_frame_id", buffer),
                call("arv_buffer_get_timestamp", buffer),
                call("arv_buffer_get_system_timestamp", buffer),
                "" if is_complete else _STATUSES.get(status, f"status {status}"),
            )
        finally:
            call("arv_stream_push_buffer", self._stream, buffer)

    def close(self) -> None:
        """Stop streaming and release the camera; a second call does nothing."""
        camera, self._camera = self._camera, None
        if camera is None:
            return
        try:
            if self._stream is not None:
                call("arv_camera_stop_acquisition", camera)
        except CameraError:
            pass  # it was unplugged
        finally:
            if self._stream is not None:
                call("g_object_unref", self._stream)
            call("g_object_unref", camera)
