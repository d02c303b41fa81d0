"""A GigE Vision camera over the loopback: Aravis simulates the camera, the rig makes its images."""

import json
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from threading import Timer

import numpy as np
import pytest

from capture import capture_set
from capture.base.errors import SetRejected
from rig import CameraError, Rig, RigConfig, open_rig
from rig.cameras.genicam.aravis import AravisCamera
from rig.cameras.genicam.fake import FakeGigeCamera
from rig.cameras.kinds import list_cameras
from rig.doctor.diagnosis import diagnose
from rig.errors import ControlError
from rig.latency import measure_latency, without_timing
from rig.simulation.camera import TRANSFER_S
from tests.gige_rig import ADDRESS, DEVICE, GigeRig, accepted_set, gige_rig, good_frame

pytestmark = pytest.mark.genicam

CAMERA = {
    "width_px": 96, "height_px": 64, "bits": 16, "frame_rate_hz": 30.0, "exposure_ms": 15.0
}  # fmt: skip
TIMEOUT_S = 60.0
ROOT = Path(__file__).parents[4]


@pytest.fixture
def served() -> Iterator[GigeRig]:
    with gige_rig(CAMERA) as rig:
        yield rig


def changed(served: GigeRig, **camera: object) -> RigConfig:
    return served.config.with_changes(camera=camera)


def frames_are_left(rig: Rig) -> bool:
    try:
        rig.camera.read(0.5)
    except CameraError:
        return False
    return True


def test_it_is_listed_with_the_keys_that_open_it(served: GigeRig) -> None:
    # A search of half a second may miss a camera of a busy machine.
    searches = (list_cameras() for _ in range(20))
    listed = next(camera for cameras in searches for camera in cameras if camera.kind == "genicam")
    assert (listed.device, listed.name, listed.problem) == (DEVICE, "Aravis Fake", None)
    assert 'pixel_format = "Mono12p"' in listed.config_lines
    for name in (DEVICE, ADDRESS, "SIM-0001"):
        config = changed(served, device=name)
        assert config.camera.matches(listed)
        with open_rig(config) as rig:
            good_frame(rig)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_three_sets_have_the_slopes_of_the_simulated_camera(bits: int) -> None:
    with gige_rig({**CAMERA, "bits": bits}) as served:
        with open_rig(served.simulated) as ideal:
            first, second = (capture_set(ideal).solve(planar=True) for _ in range(2))
        noise = np.median(np.abs(first.p - second.p))
        with open_rig(served.config) as rig:
            assert rig.camera.info.bit_depth == bits
            for _ in range(3):
                captured = accepted_set(rig)
                surface = captured.solve(planar=True)
                assert (first.valid & surface.valid).mean() > 0.95
                assert np.median(np.abs(surface.p - first.p)) < 1.2 * noise
    camera = captured.metadata.camera
    assert camera is not None
    assert camera.kind == "genicam"
    assert camera.controls["genicam"]["device"] == DEVICE
    assert captured.metadata.simulated


def test_what_the_camera_does_not_keep_is_named(served: GigeRig) -> None:
    with open_rig(changed(served, gain=3.0)) as rig:
        assert rig.camera.info.gain == 3.0
    with pytest.raises(CameraError, match=r"Mono10p.*Mono8"):
        open_rig(changed(served, pixel_format="Mono10p", bits=10))
    with pytest.raises(ControlError) as refused:
        open_rig(changed(served, trigger_line="Line7"))
    assert [fault.name for fault in refused.value.faults] == ["TriggerSource"]
    with pytest.raises(CameraError, match="Nobody"):
        open_rig(changed(served, device="Nobody"))


# Where GigE Vision cameras listen, and the register in which Aravis' camera keeps its exposure.
GVCP_PORT, EXPOSURE_US = 3956, 0x120
WRITE, READ = 0x82, 0x80


def exposure_us(*written: int) -> int:
    """Let another program write an exposure; return the one that the camera has then.

    The camera answers no program that does not control it, but for what it reads.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.settimeout(TIMEOUT_S)
        other.connect((ADDRESS, GVCP_PORT))
        for command, *words in ((WRITE, EXPOSURE_US, *written), (READ, EXPOSURE_US)):
            size = 4 * len(words)
            head = struct.pack(">BBHHH", 0x42, 1, command, size, command)
            other.send(head + struct.pack(f">{len(words)}I", *words))
        while (reply := other.recv(100))[6:8] != bytes((0, READ)):
            pass
        return int.from_bytes(reply[8:12], "big")


def test_another_program_cannot_change_the_exposure(served: GigeRig) -> None:
    with open_rig(served.config) as rig:
        dark = good_frame(rig).pixels.mean()
        assert exposure_us(1000) == 15_000
        switch = rig.lights.select(0)
        assert rig.camera.info.exposure_s == pytest.approx(0.015)
        assert good_frame(rig, switch.acknowledged_s + 0.01).pixels.mean() > 5 * dark


def test_a_program_that_lists_the_camera_is_waited_for(served: GigeRig) -> None:
    closing = Timer(0.5, AravisCamera(DEVICE).close)
    closing.start()
    with open_rig(served.config) as rig:
        good_frame(rig)
    closing.join()


# Prints the exposure start of each frame, and status 3 at the end of the stream.
READ_FRAMES = """
import sys
from rig import CameraError, RigConfig, open_rig
with open_rig(RigConfig.model_validate_json(sys.stdin.readline())) as rig:
    try:
        while True:
            print(rig.camera.read(1.0).exposure_start_s, flush=True)
    except CameraError:
        sys.exit(3)
"""


def test_a_program_that_lost_control_gets_no_frames(served: GigeRig) -> None:
    reader = subprocess.Popen(
        [sys.executable, "-c", READ_FRAMES],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    assert reader.stdin is not None
    assert reader.stdout is not None
    with reader:
        reader.stdin.write(served.config.model_dump_json() + "\n")
        reader.stdin.flush()
        reader.stdout.readline()
        # The camera hears nothing of the program that controls it, as when its machine sleeps.
        reader.send_signal(signal.SIGSTOP)
        deadline_s = time.monotonic() + 60.0
        while not (is_changed := exposure_us(1000) == 1000) and time.monotonic() < deadline_s:
            time.sleep(0.05)
        changed_s = time.monotonic()
        reader.send_signal(signal.SIGCONT)
        starts_s = [float(line) for line in reader.stdout]
    assert is_changed
    assert reader.returncode == 3
    assert max(starts_s, default=0.0) < changed_s


def test_a_frame_that_lost_packets_is_corrupt_and_in_no_set() -> None:
    with gige_rig(CAMERA, lost_packets=20.0) as served, open_rig(served.config) as rig:
        frames = [rig.camera.read(TIMEOUT_S)]
        while len({frame.is_corrupt for frame in frames}) < 2 or len(frames) < 40:
            frames.append(rig.camera.read(TIMEOUT_S))
        corrupt = [frame for frame in frames if frame.is_corrupt]
        assert not any(frame.pixels.any() for frame in corrupt)
        numbers = np.diff([frame.sequence for frame in frames])
        assert (numbers >= 1).all()
        try:
            captured = capture_set(rig)
        except SetRejected:
            return
    assert all(image.min() > 0 for image in captured.images)


def test_a_large_frame_fits_the_socket() -> None:
    camera = {**CAMERA, "width_px": 512, "height_px": 512, "bits": 12, "frame_rate_hz": 4.0}
    corrupt: list[bool] = []
    with gige_rig(camera) as served, open_rig(served.config) as rig:
        # By default 3 of 4 lost packets, also on an idle machine.
        while corrupt[-5:] != [False] * 5:
            assert len(corrupt) < 60
            corrupt.append(rig.camera.read(TIMEOUT_S).is_corrupt)


class LateFrames:
    """A rig whose camera gets no pulse at first, and is then late with each frame."""

    serial_number = "SIM-0001"
    requests = 0

    def next_frame(self, _most_late: float, _exposure_ms: float | None = None) -> None:
        time.sleep(0.02)
        self.requests += 1
        if self.requests == 1:
            raise CameraError("no frame")


def test_a_served_camera_sends_no_image_without_a_frame_and_answers(served: GigeRig) -> None:
    served.close()
    config = served.simulated.with_changes(camera={"bits": 8}).camera
    with closing(FakeGigeCamera(ADDRESS, config)) as camera:
        camera.start(LateFrames())
        with closing(AravisCamera(DEVICE)) as client:
            client.start(buffers=1)
            assert client.next_buffer(0.5) is None
            assert client.value("Width", int) > 0


def test_a_camera_that_restarts_is_found_again(served: GigeRig) -> None:
    with open_rig(served.config) as rig:
        rig.camera.read(TIMEOUT_S)
        served.restart()
        while frames_are_left(rig):
            pass
        with pytest.raises(CameraError, match="no frame"):
            rig.camera.read(0.5)
    with open_rig(served.config) as rig:
        good_frame(rig)


def test_the_doctor_checks_it(served: GigeRig, tmp_path: Path) -> None:
    camera = served.config.camera.model_dump(exclude_none=True)
    keys = "\n".join(f"{key} = {json.dumps(value)}" for key, value in camera.items())
    path = tmp_path / "rig.toml"
    path.write_text(f'[lights]\nport = "{served.port}"\n[camera]\n{keys}\n')
    checks = {check.name: check for check in diagnose(path)}
    assert checks["measurement mode"].status == "ok"
    assert checks["frame rate"].status == "ok"


def test_latency_measures_what_its_stamps_mark() -> None:
    camera = {**CAMERA, "frame_rate_hz": 60.0, "exposure_ms": 8.0}
    with gige_rig(camera) as served, open_rig(without_timing(served.config)) as rig:
        measured = measure_latency(rig, steps=14)
    assert measured.camera["timestamp_marks"] == "frame_end"
    assert measured.camera["readout_ms"] == pytest.approx(0.0, abs=0.1)
    # It stamps the end of the transfer; its clock is known to the least delay of a frame.
    offset_ms = measured.camera["timestamp_offset_ms"]
    assert isinstance(offset_ms, float)
    assert -1e3 * TRANSFER_S - 3.0 < offset_ms <= -1e3 * TRANSFER_S


@pytest.mark.parametrize("synchronisation", ["strobe", "trigger"])
def test_the_controller_runs_a_sequence(synchronisation: str) -> None:
    with gige_rig(CAMERA, synchronisation=synchronisation) as served:
        with open_rig(served.simulated) as ideal:
            truth = capture_set(ideal).images.astype(np.float32)
        with open_rig(served.config) as rig:
            sets = [accepted_set(rig) for _ in range(3)]
    for captured in sets:
        triggers = [len(image.triggers_us) for image in captured.metadata.images]
        assert triggers == [int(synchronisation == "trigger")] * len(triggers)
        assert np.abs(captured.images - truth).mean() < 0.02 * truth.mean()


def test_a_camera_that_waits_for_its_trigger_says_so(served: GigeRig) -> None:
    with open_rig(changed(served, trigger_line="Line0")) as rig:
        assert rig.camera.info.frame_period_s == pytest.approx(1 / 30)
        with pytest.raises(CameraError, match="nothing triggers it at Line0"):
            rig.camera.read(0.3)
