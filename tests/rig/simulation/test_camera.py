"""Frame timing, stale buffers and light of the simulated camera."""

from dataclasses import dataclass

import numpy as np
import pytest

from firmware_sim import Clock, SimulatedBoard, VirtualClock
from rig import Frame
from rig.scene.render import SceneImages
from rig.simulation.camera import FreeRunning, Shutter, SimulatedCamera
from rig.simulation.sensor import SensorModel

SHAPE = (32, 48)
AMBIENT = 0.05
# Light of each LED, all different, so that a mixture can be recognised.
LIGHTS = (0.4, 0.5, 0.6, 0.7)


def flat_scene(lights: tuple[float, ...] = LIGHTS) -> SceneImages:
    plane = np.zeros(SHAPE, np.float32)
    return SceneImages(
        lights=np.stack([np.full(SHAPE, light, np.float32) for light in lights]),
        ambient=np.full(SHAPE, AMBIENT, np.float32),
        shadowed=np.zeros((len(lights), *SHAPE), np.bool_),
        p=plane,
        q=plane,
        albedo=plane + 1,
    )


@dataclass(frozen=True)
class Setup:
    clock: Clock
    board: SimulatedBoard
    sensor: SensorModel
    camera: SimulatedCamera

    def light_ms(self, frame: Frame) -> float:
        """Light in a frame by its mean pixel value."""
        signal = float(frame.pixels.mean()) - self.sensor.black_level_dn
        return signal * self.sensor.gain_e_per_dn / self.sensor.white_e_per_ms


def setup(
    *,
    seed: int = 1,
    readout_ms: float = 0.0,
) -> Setup:
    clock = VirtualClock()
    board = SimulatedBoard(clock)
    sensor = SensorModel(bit_depth=12)
    camera = SimulatedCamera(
        board,
        clock,
        flat_scene(),
        sensor,
        FreeRunning(clock, Shutter(1.0 / 30.0, 0.02, readout_ms / 1e3)),
        seed=seed,
    )
    return Setup(clock, board, sensor, camera)


# timing


def test_after_a_pause_the_oldest_frames_are_first_and_a_gap_follows() -> None:
    rig = setup()
    first = rig.camera.read(1.0)
    rig.clock.sleep_s(1.0)
    now_s = rig.clock.now_s()
    stale = [rig.camera.read(1.0) for _ in range(rig.camera.info.queue_length)]
    assert rig.clock.now_s() == now_s  # they were in the queue
    assert [frame.sequence for frame in stale] == [first.sequence + n for n in (1, 2, 3, 4)]
    assert stale[0].exposure_start_s < now_s - 0.9
    fresh = rig.camera.read(1.0)
    assert fresh.sequence > stale[-1].sequence + 20
    assert fresh.exposure_end_s > now_s
    assert rig.camera.read(1.0).sequence == fresh.sequence + 1


def test_a_returned_buffer_is_filled_with_the_next_frame() -> None:
    rig = setup()
    rig.clock.sleep_s(1.0)
    rig.camera.read(1.0)
    rig.clock.sleep_s(1 / 30)
    sequences = [rig.camera.read(1.0).sequence for _ in range(4)]
    assert sequences[:3] == [1, 2, 3]
    assert 28 <= sequences[3] <= 31


# light


def test_a_frame_across_a_switch_is_a_mixture_of_both_lights() -> None:
    rig = setup()
    rig.board.set_led(0, 100)
    rig.camera.read(1.0)
    rig.clock.sleep_s(1 / 30 - 0.004 - 0.02 + 0.008)  # 8 ms into the next exposure
    rig.board.set_led(0, 0)
    rig.board.set_led(3, 100)
    frame = rig.camera.read(1.0)
    start_s, end_s = frame.exposure_start_s, frame.exposure_end_s
    before_ms = 1e3 * rig.board.output_integral_s(0, start_s, end_s)
    after_ms = 1e3 * rig.board.output_integral_s(3, start_s, end_s)
    assert before_ms == pytest.approx(8.0, abs=0.3)
    assert after_ms == pytest.approx(12.0, abs=0.3)
    expected_ms = AMBIENT * 20.0 + LIGHTS[0] * before_ms + LIGHTS[3] * after_ms
    assert rig.light_ms(frame) == pytest.approx(expected_ms, rel=2e-3)


def test_each_row_of_a_rolling_shutter_has_its_own_exposure() -> None:
    rig = setup(readout_ms=12.0)
    rig.board.set_led(0, 100)
    rig.camera.read(1.0)
    rig.clock.sleep_s(1 / 30 - 0.016 - 0.02 + 0.010)  # 10 ms into the next exposure
    rig.board.set_led(0, 0)
    rig.board.set_led(3, 100)
    frame = rig.camera.read(1.0)
    shares = []
    for row, pixels in enumerate(frame.pixels):
        start_s = frame.exposure_start_s + row / (SHAPE[0] - 1) * 0.012
        lit_ms = [1e3 * rig.board.output_integral_s(led, start_s, start_s + 0.02) for led in (0, 3)]
        expected_ms = AMBIENT * 20.0 + LIGHTS[0] * lit_ms[0] + LIGHTS[3] * lit_ms[1]
        shares.append(lit_ms[1] / 20.0)
        signal = float(pixels.mean()) - rig.sensor.black_level_dn
        light_ms = signal * rig.sensor.gain_e_per_dn / rig.sensor.white_e_per_ms
        assert light_ms == pytest.approx(expected_ms, rel=0.02)
    # The new LED lights half of the first row's exposure, and nearly all of the last row's.
    assert shares[0] == pytest.approx(0.5, abs=0.03)
    assert shares[-1] > 0.98


@pytest.mark.parametrize("readout_ms", [0.0, 12.0])
def test_a_frame_is_returned_after_the_exposure_of_its_last_row(readout_ms: float) -> None:
    rig = setup(readout_ms=readout_ms)
    for _ in range(20):
        frame = rig.camera.read(1.0)
        assert rig.clock.now_s() >= frame.exposure_end_s + readout_ms / 1e3


def test_frames_in_the_queue_show_the_earlier_part() -> None:
    rig = setup()
    rig.board.set_led(0, 100)
    rig.clock.sleep_s(1.0)
    rig.camera.replace_scene(flat_scene((0.1, 0.1, 0.1, 0.1)), seed=2)
    means = [rig.light_ms(rig.camera.read(1.0)) for _ in range(6)]
    # Frame 0 was exposed while the LED was still rising.
    np.testing.assert_allclose(means[1:4], 20.0 * (AMBIENT + LIGHTS[0]), rtol=5e-3)
    np.testing.assert_allclose(means[4:], 20.0 * (AMBIENT + 0.1), rtol=5e-3)


# pixels


def test_the_info_states_the_noise_of_the_sensor() -> None:
    rig = setup()
    for name in ("gain_e_per_dn", "read_noise_dn", "black_level_dn"):
        assert getattr(rig.camera.info, name) == getattr(rig.sensor, name)


def test_frames_depend_on_the_seed_only() -> None:
    def frames(seed: int) -> list[bytes]:
        rig = setup(seed=seed)
        rig.board.set_led(2, 100)
        return [rig.camera.read(1.0).pixels.tobytes() for _ in range(3)]

    assert frames(5) == frames(5)
    assert all(a != b for a, b in zip(frames(5), frames(6), strict=True))
    assert len(set(frames(5))) == 3
