"""Frames that the camera delivers twice, recognised by number or by pixels."""

from rig import Frame

# Pixels compared. With noise of 1 DN two exposures agree in a third of their pixels; even where
# most of the noise is rounded away, some of so many pixels differ.
_SAMPLED_PX = 4096


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
