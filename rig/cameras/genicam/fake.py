"""`FakeGigeCamera`: a GigE Vision camera of this machine, whose images a function makes."""

import ctypes
import time
from collections.abc import Callable

from rig.errors import CameraError

from .aravis import FRAME_IDS, call

# Of an exposure in ms: the image as bytes, its number, and its end on the monotonic clock.
NextImage = Callable[[float], tuple[bytes, int, float]]

_FILL = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)


class FakeGigeCamera:
    """Aravis' fake camera at an address of this machine, with the id ``Aravis-Fake-SERIAL``.

    Its client sets size, rate and exposure. `next_image` is called in a thread of Aravis once a
    frame. Of 1,000 packets `lost_packets` do not arrive.
    """

    def __init__(
        self, address: str, serial: str, next_image: NextImage, lost_packets: float = 0.0
    ) -> None:
        self._camera = call("arv_gv_fake_camera_new", address.encode(), serial.encode())
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
            call("arv_buffer_set_frame_id", buffer, 1 + number % FRAME_IDS)

        self._fill = _FILL(fill)  # kept as long as Aravis may call it
        fake = call("arv_gv_fake_camera_get_fake_camera", self._camera)
        call("arv_fake_camera_set_fill_pattern", fake, self._fill, None)
        call("g_object_set", self._camera, b"gvsp-lost-ratio", lost_packets / 1e3, None)

    def close(self) -> None:
        """End the camera; a second call does nothing."""
        camera, self._camera = self._camera, None
        if camera is not None:
            call("g_object_unref", camera)
