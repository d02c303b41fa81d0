"""`FakeGigeCamera`: a GigE Vision camera of this machine, whose images a function makes."""

import ctypes
import tempfile
import time
from collections.abc import Callable

from rig.errors import CameraError

from .aravis import FRAME_ID_COUNT, call

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

_FILL = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)


class FakeGigeCamera:
    """Aravis' fake camera at an address of this machine, with the id ``Aravis-Fake-SERIAL``.

    Its client sets size, rate, exposure and trigger. `next_image` is called in a thread of Aravis
    once a frame, or once a `trigger`. Of 1,000 packets `lost_packets` do not arrive.
    """

    def __init__(
        self, address: str, serial: str, next_image: _NextImage, lost_packets: float = 0.0
    ) -> None:
        with tempfile.NamedTemporaryFile(suffix=".xml") as features:
            features.write(_features())
            features.flush()
            self._camera = call(
                "arv_gv_fake_camera_new_full",
                address.encode(),
                serial.encode(),
                features.name.encode(),
            )
        if not call("arv_gv_fake_camera_is_running", self._camera):
            call("g_object_unref", self._camera)
            raise CameraError(
                f"{address}: no GigE Vision camera can be simulated there; give an address of this "
                "machine, whose port 3956 is free"
            )

        def fill(buffer: int, _: int, exposure_us: int, _gain: int, pixel_format: int) -> None:
            image, number, end_s = next_image(exposure_us / 1e3)
            pixels = 1
            for side in ("width", "height"):
                pixels *= call(f"arv_buffer_get_image_{side}", buffer)
            room = pixels * (pixel_format >> 16 & 0xFF) // 8  # PFNC: bits of a pixel
            target = call("arv_buffer_get_data", buffer, None)
            ctypes.memmove(target, image, min(len(image), room))
            utc_ns = time.time_ns() - round(1e9 * (time.monotonic() - end_s))
            call("arv_buffer_set_timestamp", buffer, utc_ns)
            call("arv_buffer_set_frame_id", buffer, 1 + number % FRAME_ID_COUNT)

        self._fill = _FILL(fill)  # kept as long as Aravis may call it
        self._fake = call("arv_gv_fake_camera_get_fake_camera", self._camera)
        call("arv_fake_camera_set_fill_pattern", self._fake, self._fill, None)
        call("arv_fake_camera_set_trigger_frequency", self._fake, _TRIGGER_POLLS_HZ)
        call("g_object_set", self._camera, b"gvsp-lost-ratio", lost_packets / 1e3, None)

    def trigger(self) -> None:
        """A pulse at `TRIGGER_LINE`: an image is sent as soon as `next_image` gives one.

        Pulses that follow each other before Aravis looks count as one.
        """
        if self._camera is not None:
            call("arv_fake_camera_write_register", self._fake, _TRIGGER_REGISTER, 1)

    def close(self) -> None:
        """End the camera; a second call does nothing."""
        camera, self._camera = self._camera, None
        if camera is not None:
            call("g_object_unref", camera)


def _features() -> bytes:
    """Aravis' description of its fake camera, with `_CHANGES`."""
    camera, size = call("arv_fake_camera_new", b"any"), ctypes.c_size_t()
    text = call("arv_fake_camera_get_genicam_xml", camera, ctypes.byref(size))
    features = ctypes.string_at(text, size.value)
    call("g_object_unref", camera)
    for old, new in _CHANGES:
        features = features.replace(old.encode(), new.encode())
    return features
