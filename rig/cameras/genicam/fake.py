"""`FakeGigeCamera`: a GigE Vision camera of this machine, whose images a function makes."""

import ctypes
import tempfile
import time
from collections.abc import Callable
from functools import cache
from typing import Any

from rig.errors import CameraError

from .aravis import FRAME_ID_COUNT, aravis

# Of an exposure in ms: the image as bytes, its number, and its end on the monotonic clock.
_NextImage = Callable[[float], tuple[bytes, int, float]]

TRIGGER_LINE = "Line1"
# Aravis knows triggers by software alone, and no packed pixels: here that source is called as an
# input of the camera, and its colour format is replaced by one with 12 bits a pixel (PFNC).
_CHANGES = (
    ('Name="Software"', f'Name="{TRIGGER_LINE}"'),
    ('Name="RGB8"', 'Name="Mono12p"'),
    (f"<Value>{0x02180014}</Value>", f"<Value>{0x010C0047}</Value>"),
)
_TRIGGER_REGISTER = 0x30C
# How often Aravis looks whether it was triggered.
_TRIGGER_POLLS_HZ = 1000.0

_POINTER = ctypes.c_void_p
_FILL = ctypes.CFUNCTYPE(None, _POINTER, _POINTER, *(ctypes.c_uint32,) * 3)


@cache
def _c_library() -> ctypes.CDLL:
    """Aravis without PyGObject, which copies a buffer and forgets a function once it is set."""
    library = ctypes.CDLL("libaravis-0.8.so.0")
    library.arv_fake_camera_set_fill_pattern.argtypes = (_POINTER, _FILL, _POINTER)
    library.arv_buffer_get_data.argtypes = (_POINTER, _POINTER)
    library.arv_buffer_get_data.restype = _POINTER
    library.arv_buffer_set_timestamp.argtypes = (_POINTER, ctypes.c_uint64)
    library.arv_buffer_set_frame_id.argtypes = (_POINTER, ctypes.c_uint64)
    return library


def _pointer(instance: Any) -> int:
    """Address of a GObject."""
    get_pointer = ctypes.pythonapi.PyCapsule_GetPointer
    get_pointer.argtypes, get_pointer.restype = (ctypes.py_object, ctypes.c_char_p), _POINTER
    address: int = get_pointer(instance.__gpointer__, None)
    return address


class FakeGigeCamera:
    """Aravis' fake camera at an address of this machine, with the id ``Aravis-Fake-SERIAL``.

    Its client sets size, rate, exposure and trigger. `next_image` is called in a thread of Aravis
    once a frame, or once a `trigger`. Of 1,000 packets `lost_packets` do not arrive.
    """

    def __init__(
        self, address: str, serial: str, next_image: _NextImage, lost_packets: float = 0.0
    ) -> None:
        library = aravis()
        with tempfile.NamedTemporaryFile("w", suffix=".xml", encoding="utf-8") as features:
            features.write(_features())
            features.flush()
            self._camera: Any = library.GvFakeCamera.new_full(address, serial, features.name)
        if not self._camera.is_running():
            raise CameraError(
                f"{address}: no GigE Vision camera can be simulated there; give an address of this "
                "machine, whose port 3956 is free"
            )
        fake = self._camera.get_fake_camera()

        def fill(buffer: int, *values: int) -> None:
            image, number, end_s = next_image(values[1] / 1e3)  # exposure in us
            room = fake.get_payload()
            target = _c_library().arv_buffer_get_data(buffer, None)
            ctypes.memmove(target, image, min(len(image), room))
            utc_ns = time.time_ns() - round(1e9 * (time.monotonic() - end_s))
            _c_library().arv_buffer_set_timestamp(buffer, utc_ns)
            _c_library().arv_buffer_set_frame_id(buffer, 1 + number % FRAME_ID_COUNT)

        self._fill = _FILL(fill)  # kept as long as Aravis may call it
        self._fake: Any = fake
        _c_library().arv_fake_camera_set_fill_pattern(_pointer(fake), self._fill, None)
        fake.set_trigger_frequency(_TRIGGER_POLLS_HZ)
        self._camera.props.gvsp_lost_ratio = lost_packets / 1e3

    def trigger(self) -> None:
        """A pulse at `TRIGGER_LINE`: an image is sent as soon as `next_image` gives one.

        Pulses that follow each other before Aravis looks count as one.
        """
        self._fake.write_register(_TRIGGER_REGISTER, 1)

    def close(self) -> None:
        """End the camera; a second call does nothing."""
        self._camera = None


def _features() -> str:
    """Aravis' description of its fake camera, with `_CHANGES`."""
    features: str = aravis().FakeCamera.new("any").get_genicam_xml()[0]
    for old, new in _CHANGES:
        features = features.replace(old, new)
    return features
