"""The frames of a sequence that the light controller runs."""

from capture.base.errors import SetRejected
from rig import CameraError, Frame, FrameFlag, Rig

from .frame_checks import check_frame


class SequenceFrames:
    """The frames `received` that were exposed after a sequence was started."""

    def __init__(self, rig: Rig, since_s: float, deadline_s: float) -> None:
        self._rig = rig
        self._since_s = since_s
        self._deadline_s = deadline_s
        self._previous: int | None = None
        self.received: list[Frame] = []

    def take(self) -> bool:
        """Read one more frame; return False if none arrives in time."""
        camera, clock = self._rig.camera, self._rig.clock
        try:
            frame = camera.read(max(0.0, self._deadline_s - clock.now_s()))
        except CameraError:
            if not self.received:
                raise
            return False
        check_frame(frame, camera.info, clock.now_s())
        previous = self._previous
        if previous is not None and frame.sequence <= previous:
            raise SetRejected(
                f"set rejected: frame {frame.sequence} came twice: the camera repeats frames; "
                "check its cable"
            )
        self._previous = frame.sequence
        if self.received and previous is not None and frame.sequence > previous + 1:
            raise SetRejected(
                f"set rejected: frame {previous + 1} was lost; check the camera's cable and the "
                "computer's load"
            )
        if frame.exposure_end_s >= self._since_s:
            self.received.append(frame)
        return True

    def begin(self, since_s: float, deadline_s: float) -> None:
        """Forget the frames that were exposed before `since_s`; read until `deadline_s`."""
        self._since_s, self._deadline_s = since_s, deadline_s
        self.received = [frame for frame in self.received if frame.exposure_end_s >= since_s]

    def at(self, begun_s: float, tolerance_s: float, name: str) -> Frame:
        """The good frame whose exposure began at `begun_s`."""
        near = [f for f in self.received if abs(f.exposure_start_s - begun_s) <= tolerance_s]
        if len(near) != 1:
            nearest_ms = 1e3 * min((f.exposure_start_s - begun_s for f in self.received), key=abs)
            raise SetRejected(
                f"set rejected: {len(near)} of {len(self.received)} frames fit the exposure under "
                f"{name}, the nearest began {nearest_ms:+.1f} ms from it; if that stays so, run "
                "ps4rig rig latency"
            )
        if near[0].flags != FrameFlag.GOOD:
            raise SetRejected(
                f"set rejected: the frame under {name} is corrupt; check the camera's cable"
            )
        return near[0]
