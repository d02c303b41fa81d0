"""A simulated rig that OpenCV reads as an endless film."""

import fcntl
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rig import Camera, CameraError, Rig, RigConfig, open_rig
from rig.simulation.rig import Simulation

# Long enough for a busy machine.
_READ_TIMEOUT_S = 20.0
# The smallest pipe: one or two frames wait in it, as in a driver's buffers.
_PIPE_BYTES = 4096


@contextmanager
def rig_of_opencv(camera: dict[str, Any], pipe: Path) -> Iterator[Rig]:
    """Open a rig whose camera is OpenCV's; LEDs and part are those of a simulated rig.

    Parameters
    ----------
    camera
        Size, frame rate and exposure.
    pipe
        The path at which a pipe for the film is made.
    """
    simulated = RigConfig().with_changes(camera=camera | {"bits": 8}, simulation={"clock": "real"})
    simulation = Simulation(simulated)
    os.mkfifo(pipe)
    film = threading.Thread(target=_film, args=(simulation.camera_with_faults, simulated, pipe))
    film.start()
    real = {"kind": "opencv", "device": str(pipe), "bits": 8, "fixed_exposure": True}
    try:
        with open_rig(
            RigConfig.model_validate({"lights": {"port": simulation.port}, "camera": camera | real})
        ) as opened:
            yield opened
    finally:
        # If nobody opened the film, its thread still waits for a reader.
        os.close(os.open(pipe, os.O_RDONLY | os.O_NONBLOCK))
        film.join()
        simulation.close()


def _film(camera: Camera, config: RigConfig, pipe: Path) -> None:
    """Write frames until nobody reads; while the pipe is full, the camera buffers them."""
    size = config.camera
    with pipe.open("wb", buffering=0) as out:
        fcntl.fcntl(out, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        try:
            # Format: https://wiki.multimedia.cx/index.php/YUV4MPEG2, grey values only
            head = f"W{size.width_px} H{size.height_px} F{size.frame_rate_hz:.0f}:1 Ip A1:1 Cmono"
            out.write(f"YUV4MPEG2 {head}\n".encode())
            while True:
                out.write(b"FRAME\n" + camera.read(_READ_TIMEOUT_S).pixels.tobytes())
        except (BrokenPipeError, CameraError):
            return
