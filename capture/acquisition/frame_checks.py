"""Checks of each frame: as announced, and not delivered twice."""

from rig import CameraError, CameraInfo, Frame

# Pixels compared. With noise of 1 DN two exposures agree in a third of their pixels; even where
# most of the noise is rounded away, some of so many pixels differ.
_SAMPLED_PX = 4096


def check_frame(frame: Frame, info: CameraInfo, now_s: float) -> None:
    """Reject a frame that the camera did not announce, or that is stamped in the future."""
    rows, columns = frame.pixels.shape
    if (rows, columns, frame.bit_depth) != (info.height_px, info.width_px, info.bit_depth):
        raise CameraError(
            f"the camera sent {columns} x {rows} px of {frame.bit_depth} bit instead of "
            f"{info.width_px} x {info.height_px} px of {info.bit_depth} bit; open it again"
        )
    if not frame.exposure_start_s <= frame.exposure_end_s <= now_s:
        raise CameraError(
            f"frame {frame.sequence} is stamped {frame.exposure_start_s:.6f} to "
            f"{frame.exposure_end_s:.6f} s and arrived at {now_s:.6f} s; the camera's time stamps "
            "are not on the rig's clock: run ps4rig rig latency, or use another camera"
        )


class RepeatDetector:
    """A detector of frames that repeat the previous frame.

    A camera without noise, such as one that replays a set, delivers the same pixels each time: a
    frame whose pixels come a third time in a row is not a repeat.
    """

    def __init__(self) -> None:
        self._sequence: int | None = None
        self._sample = b""
        self._is_repeat = False

    def is_repeat(self, frame: Frame) -> bool:
        """Whether a frame repeats the one of the previous call."""
        sample = _sample(frame)
        same_number = self._sequence is not None and frame.sequence <= self._sequence
        same_pixels = sample != b"" and sample == self._sample and not self._is_repeat
        self._is_repeat = same_number or same_pixels
        self._sequence = max(frame.sequence, self._sequence or 0)
        self._sample = sample
        return self._is_repeat


def _sample(frame: Frame) -> bytes:
    """Pixels spread over the frame; empty for a uniform one: dark frames may be equal."""
    pixels = frame.pixels.reshape(-1)
    sample = pixels[:: max(1, pixels.size // _SAMPLED_PX)]
    return sample.tobytes() if int(sample.max()) - int(sample.min()) > 1 else b""
