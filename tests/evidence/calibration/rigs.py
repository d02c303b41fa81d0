"""Simulated rigs with and without faults, and the sets that a user captures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from capture.acquisition.attempts import capture_set
from capture.sets.captured_set import CapturedSet
from rig import Placement, Rig, RigConfig, open_rig
from rig.scene.render import SceneImages

LED_LEVELS = (1.0, 0.9, 1.1, 0.95)
AMBIENT, VIGNETTING_PERCENT, HOT_PIXELS = 0.03, 20.0, 20
# A white sheet then stays below saturation where it is nearest to an LED at two fields of view.
EXPOSURE_MS = 14.0


@dataclass(frozen=True)
class Conditions:
    """A rig with faults.

    Attributes
    ----------
    fields
        Distance of the LEDs in sides of the frame; None for distant LEDs.
    bits, gamma
        Pixel depth and response of the camera.
    size_px
        Side of the frame.
    """

    fields: float | None
    bits: int
    gamma: float
    size_px: int

    @property
    def camera(self) -> str:
        """Depth and response of the camera, as text."""
        response = "linear" if self.gamma == 1.0 else f"gamma {self.gamma:g}"
        return f"{self.bits} bit, {response}"

    @property
    def faulty(self) -> RigConfig:
        """The rig with all faults."""
        return self.ideal.with_changes(
            simulation={
                "led_distance_px": self.led_distance_px,
                "led_levels": LED_LEVELS,
                "ambient": AMBIENT,
                "vignetting_percent": VIGNETTING_PERCENT,
                "response_gamma": self.gamma,
                "hot_pixels": HOT_PIXELS,
            }
        )

    @property
    def ideal(self) -> RigConfig:
        """The rig with distant and equal LEDs, no vignetting and a linear camera."""
        return RigConfig().with_changes(
            camera={
                "width_px": self.size_px,
                "height_px": self.size_px,
                "bits": self.bits,
                "exposure_ms": EXPOSURE_MS,
            }
        )

    @property
    def led_distance_px(self) -> float | None:
        """Distance of the LEDs from the middle of the frame."""
        return None if self.fields is None else self.fields * self.size_px


@dataclass(frozen=True, eq=False)
class Part:
    """A captured set of a part, and its true surface."""

    captured: CapturedSet
    truth: SceneImages


def capture_part(config: RigConfig, surface: str) -> Part:
    """Capture one set of a surface."""
    with open_rig(config.with_changes(simulation={"placement": {"surface": surface}})) as rig:
        assert rig.simulation is not None
        scene = rig.simulation.camera.scene
        assert isinstance(scene, SceneImages)
        return Part(capture_set(rig, surface), scene)


def captured_targets(
    rig: Rig, placements: Sequence[Placement], average: int = 1
) -> Iterator[CapturedSet]:
    """Yield a set of a calibration target at each of its placements below a simulated rig."""
    assert rig.simulation is not None
    for placement in placements:
        rig.simulation.place(placement)
        yield capture_set(rig, average=average, is_target=True)
