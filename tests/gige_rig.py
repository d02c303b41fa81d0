"""A simulated rig whose camera sends its frames by GigE Vision over the loopback."""

import fcntl
import math
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from capture import CapturedSet, capture_set
from capture.base.errors import SetRejected
from rig import Frame, HardwareError, Rig, RigConfig, open_rig
from rig.cameras.genicam.fake import TRIGGER_LINE, FakeGigeCamera
from rig.simulation.camera import TRANSFER_S
from rig.simulation.devices import DeviceSimulation

ADDRESS, DEVICE = "127.0.0.1", "Aravis-Fake-SIM-0001"
# One camera may listen at an address: tests in several processes wait for each other.
_LOCK = Path(tempfile.gettempdir()) / "ps4rig-gige.lock"
# Sets that a busy machine may spoil one after the other.
_ATTEMPTS = 30


@dataclass
class GigeRig:
    """The simulation, and the configuration that opens it."""

    simulated: RigConfig
    lost_packets: float
    port: Path
    simulation: DeviceSimulation = field(init=False)

    def __post_init__(self) -> None:
        self._start()

    @property
    def config(self) -> RigConfig:
        camera = self.simulated.camera
        keys = ("width_px", "height_px", "frame_rate_hz", "exposure_ms")
        synchronisation = self.simulated.lights.synchronisation
        trigger = {"trigger_line": TRIGGER_LINE} if synchronisation == "trigger" else {}
        return RigConfig.model_validate(
            {
                "lights": {"port": str(self.port), "synchronisation": synchronisation},
                "camera": {key: getattr(camera, key) for key in keys}
                | {
                    "kind": "genicam",
                    "device": DEVICE,
                    "pixel_format": {8: "Mono8", 12: "Mono12p", 16: "Mono16"}[camera.bits],
                    "readout_ms": self.simulated.simulation.readout_ms,
                    "timestamp_offset_ms": -1e3 * TRANSFER_S,
                    # The fake camera has no clock to be read: a busy machine stamps late.
                    "timestamp_uncertainty_ms": 2.0,
                }
                | trigger,
            }
        )

    def restart(self) -> None:
        """Lights and camera are gone for a moment."""
        self.close()
        self._start()

    def close(self) -> None:
        """Remove the name of the terminal first: a rig would open another test's of that number."""
        self.port.unlink(missing_ok=True)
        self.simulation.close()

    def _start(self) -> None:
        self.simulation = DeviceSimulation(self.simulated, serial=None, served=f"genicam:{ADDRESS}")
        assert isinstance(self.simulation.camera, FakeGigeCamera)
        self.simulation.camera.lose_packets(self.lost_packets / 1e3)
        self.port.symlink_to(self.simulation.port)


@contextmanager
def gige_rig(
    camera: dict[str, Any], lost_packets: float = 0.0, synchronisation: str = "software"
) -> Iterator[GigeRig]:
    """Serve a simulated rig; `lost_packets` of 1,000 do not arrive."""
    config = RigConfig().with_changes(camera=camera, lights={"synchronisation": synchronisation})
    with _LOCK.open("w") as lock, tempfile.TemporaryDirectory() as folder:
        fcntl.flock(lock, fcntl.LOCK_EX)
        served = GigeRig(config, lost_packets, Path(folder) / "port")
        try:
            yield served
        finally:
            served.close()


@contextmanager
def rig_of_genicam(camera: dict[str, Any]) -> Iterator[Rig]:
    """Open such a rig, and let the camera's clock be tied to this machine's."""
    with gige_rig(camera) as served, open_rig(served.config) as opened:
        for _ in range(10):
            opened.camera.read(60.0)
        yield opened


def accepted_set(rig: Rig) -> CapturedSet:
    """A set; on a busy machine the simulated hardware is late, and sets are rejected."""
    for _ in range(_ATTEMPTS):
        with suppress(SetRejected, HardwareError):
            return capture_set(rig)
    return capture_set(rig)


def good_frame(rig: Rig, begun_s: float = -math.inf) -> Frame:
    """The next complete frame whose exposure began at a time or later."""
    while (frame := rig.camera.read(60.0)).is_corrupt or frame.exposure_start_s < begun_s:
        pass
    return frame
