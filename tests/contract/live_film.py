"""A simulated rig as OpenCV can see one: its frames are a film that does not end."""

import fcntl
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rig import Camera, CameraError, Rig, RigConfig, open_rig
from rig.simulation.rig import Simulation

__all__ = ["rig_of_opencv"]

_READ_TIMEOUT_S = 1.0
# As little as a pipe can hold: a frame or two wait in it, as in a driver's buffers.
_PIPE_BYTES = 4096


@contextmanager
def rig_of_opencv(camera: dict[str, Any], pipe: Path) -> Iterator[Rig]:
    """A rig with a camera of OpenCV, above the LEDs and the part of a simulated one.

    Parameters
    ----------
    camera
        Size, frame rate and exposure.
    pipe
        Made here, for the film.
    """
    simulated = RigConfig().with_changes(camera=camera | {"bits": 8}, simulation={"clock": "real"})
    simulation = Simulation(simulated)
    os.mkfifo(pipe)
    film = threading.Thread(target=_film, args=(simulation.frames, simulated, pipe))
    film.start()
    real = {"kind": "opencv", "device": str(pipe), "bits": 8, "fixed_exposure": True}
    try:
        with open_rig(
            RigConfig.model_validate({"lights": {"port": simulation.port}, "camera": camera | real})
        ) as opened:
            yield opened
    finally:
        # A film that nobody came to see still waits for its first spectator.
        os.close(os.open(pipe, os.O_RDONLY | os.O_NONBLOCK))
        film.join()
        simulation.close()


def _film(camera: Camera, config: RigConfig, pipe: Path) -> None:
    """Write frames until nobody reads; those that find no room wait in the camera's buffers."""
    size = config.camera
    with pipe.open("wb", buffering=0) as out:
        fcntl.fcntl(out, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        try:
            # https://wiki.multimedia.cx/index.php/YUV4MPEG2, of grey values alone
            head = f"W{size.width_px} H{size.height_px} F{size.frame_rate_hz:.0f}:1 Ip A1:1 Cmono"
            out.write(f"YUV4MPEG2 {head}\n".encode())
            while True:
                out.write(b"FRAME\n" + camera.read(_READ_TIMEOUT_S).pixels.tobytes())
        except (BrokenPipeError, CameraError):
            return
