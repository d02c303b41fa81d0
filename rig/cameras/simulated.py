"""Configurations of the cameras of a simulated rig; `rig.simulation.camera` is their camera."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from .config import StampedCameraConfig


class SimulatedCameraConfig(StampedCameraConfig):
    """The simulated camera above a rendered surface."""

    kind: Literal["simulated"] = "simulated"


class ReplayCameraConfig(StampedCameraConfig):
    """A simulated camera that replays a captured set, in the set's size and depth."""

    kind: Literal["replay"] = "replay"
    set_file: str = Field(
        min_length=1, max_length=4096, description="the set to replay, relative to rig.toml"
    )

    @property
    def recording(self) -> Path:
        """The captured set that the camera replays."""
        return Path(self.set_file)
