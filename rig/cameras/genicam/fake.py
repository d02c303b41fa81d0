"""`FakeGigeCamera`: a GigE Vision camera of this machine with the frames of a simulated rig."""

import ctypes
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any, ClassVar

import numpy as np

from classify.base.errors import ConfigError
from rig.cameras.camera import Pixels
from rig.cameras.config import CameraConfig
from rig.cameras.served import FrameSource
from rig.errors import CameraError

from .aravis import FRAME_ID_COUNT, aravis
from .measurement_mode import GenicamCameraConfig
from .pixel_formats import packed_12p

TRIGGER_LINE = "Line1"
# Aravis' fake camera has only a software trigger, and no packed pixels. Its trigger source gets the
# name of an input line, and its colour format is replaced by one with 12 bits a pixel (PFNC).
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
    """Aravis by ctypes: PyGObject copies buffers, and frees a callback once it is set."""
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


# Frames later than this share of a period are skipped: a free-running camera sends a frame as
# soon as it is read out.
_MAX_LATE_PERIODS = 0.25
# Number of late frames that are skipped, or of waits of two periods for a pulse, before the thread
# must answer its client again.
_MAX_ATTEMPTS = 8
_ALL_PACKETS = 1.0  # share of the packets of a frame
# By depth: a format, and the function that encodes an image.
_FORMATS: dict[int, tuple[str, Callable[[Pixels], bytes]]] = {
    8: ("Mono8", lambda pixels: pixels.astype(np.uint8, copy=False).tobytes()),
    12: ("Mono12p", packed_12p),
    16: ("Mono16", lambda pixels: pixels.astype("<u2", copy=False).tobytes()),
}


class FakeGigeCamera:
    """Aravis' fake camera ``Aravis-Fake-SERIAL`` at an address of this machine.

    A thread of Aravis requests the frames.
    """

    place_help: ClassVar[str] = "ADDRESS, one of this machine"

    def __init__(self, place: str, config: CameraConfig) -> None:
        self._address = place
        self._camera: Any = None
        self._lost_share = 0.0
        self._period_s = 1.0 / config.frame_rate_hz
        self.bit_depth: int = config.bits if config.bits in _FORMATS else 16
        self.pixel_format, self._encoded = _FORMATS[self.bit_depth]
        if isinstance(config, GenicamCameraConfig) and config.pixel_format != self.pixel_format:
            raise ConfigError(
                f"camera.pixel_format = {config.pixel_format!r} cannot be simulated; it can be "
                + " or ".join(name for name, _ in _FORMATS.values())
            )

    def start(self, source: FrameSource) -> None:
        library = aravis()
        with tempfile.NamedTemporaryFile("w", suffix=".xml", encoding="utf-8") as features:
            features.write(_features())
            features.flush()
            self._camera = library.GvFakeCamera.new_full(
                self._address, source.serial_number, features.name
            )
        if not self._camera.is_running():
            raise CameraError(
                f"{self._address}: no GigE Vision camera can be simulated there; give an address "
                "of this machine, whose port 3956 is free"
            )
        fake = self._camera.get_fake_camera()

        def fill(buffer: int, _data: int, exposure_us: int, *_: int) -> None:
            frame = None
            with suppress(CameraError):  # no pulse for two periods
                for _attempt in range(_MAX_ATTEMPTS):
                    frame = source.next_frame(_MAX_LATE_PERIODS, exposure_us / 1e3)
                    if frame is not None:
                        break
            if self._camera is None:  # `close` waits for this thread
                return
            # The buffer has an earlier image, which may not be sent again.
            self._camera.props.gvsp_lost_ratio = _ALL_PACKETS if frame is None else self._lost_share
            if frame is None:
                return
            image = self._encoded(frame.pixels)
            payload_bytes = fake.get_payload()
            target = _c_library().arv_buffer_get_data(buffer, None)
            ctypes.memmove(target, image, min(len(image), payload_bytes))
            utc_ns = time.time_ns() - round(1e9 * (time.monotonic() - frame.end_s))
            _c_library().arv_buffer_set_timestamp(buffer, utc_ns)
            _c_library().arv_buffer_set_frame_id(buffer, 1 + frame.number % FRAME_ID_COUNT)

        self._fill = _FILL(fill)  # kept as long as Aravis may call it
        self._fake: Any = fake
        _c_library().arv_fake_camera_set_fill_pattern(_pointer(fake), self._fill, None)
        fake.set_trigger_frequency(_TRIGGER_POLLS_HZ)

    def lose_packets(self, share: float) -> None:
        """Drop a share of the packets."""
        self._lost_share = share

    def step(self) -> None:
        time.sleep(self._period_s)

    def trigger(self) -> None:
        """A pulse at `TRIGGER_LINE` sends one image; pulses before Aravis looks count as one."""
        self._fake.write_register(_TRIGGER_REGISTER, 1)

    def close(self) -> None:
        if self._camera is not None:
            self._camera.props.gvsp_lost_ratio = _ALL_PACKETS
        self._camera = None  # waits for `fill`


def _features() -> str:
    """Aravis' description of its fake camera, with `_CHANGES`."""
    features: str = aravis().FakeCamera.new("any").get_genicam_xml()[0]
    for old, new in _CHANGES:
        features = features.replace(old, new)
    return features
