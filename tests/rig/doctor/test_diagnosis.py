"""The doctor on simulated rigs, with and without faults."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from classify import Lighting
from firmware_sim import SimulatedBoard, SimulatedController, VirtualClock, serve_pty
from rig import LightControllerError, ListedCamera, RigConfig, open_rig
from rig.cameras.v4l2.measurement_mode import V4l2CameraConfig
from rig.doctor import diagnosis as doctor_module
from rig.doctor.check import Check
from rig.doctor.devices import (
    RULES_FILE,
    check_cameras,
    check_frames,
    check_lights,
    check_modem_manager,
    check_port,
    check_ports,
    exposure_range_ms,
)
from rig.doctor.diagnosis import check_kernel_cache, diagnose
from rig.doctor.light_images import LightImages, capture_light_images, check_light_images
from rig.lights.discovery import _VENDORS, SerialPort
from rig.lights.driver import LightController, switch_latencies_ms
from rig.lights.link import DEFAULT_TIMEOUTS, LinkTimeouts

SMALL = "[camera]\nwidth_px = 160\nheight_px = 160\n[lights]\nport = 'simulated'\n"


@pytest.fixture
def checks_of(tmp_path: Path) -> Any:
    """Return the checks of a simulated rig with given lines in its rig.toml, by name."""

    def diagnosed(
        lines: str = "", text: str = SMALL, timeouts: LinkTimeouts = DEFAULT_TIMEOUTS
    ) -> dict[str, Check]:
        path = tmp_path / "rig.toml"
        path.write_text(text + lines)
        return {check.name: check for check in diagnose(path, timeouts)}

    return diagnosed


def led_fault(kind: str, led: int, more: str = "") -> str:
    return f"[[simulation.faults.leds]]\nkind = '{kind}'\nled = {led}\n{more}\n"


def test_a_rig_without_faults_has_only_good_checks(checks_of: Any) -> None:
    checks = checks_of()
    bad = {name: check for name, check in checks.items() if check.status in ("fault", "unknown")}
    assert bad == {}
    assert {
        "configuration", "light controller", "LEDs", "watchdog", "switch latency",
        "measurement mode", "frame rate", "frames", "ambient light", "LED 0", "LED 1", "LED 2",
        "LED 3", "saturation", "exposure", "LED order", "ModemManager", "compiled kernels",
    } <= {*checks}  # fmt: skip
    assert "protocol 2" in checks["light controller"].seen
    assert checks["frame rate"].seen.startswith("30.00 Hz reached, 30.00 Hz")
    assert checks["switch latency"].seen.startswith("median 1.00 ms, worst 1.00 ms")


FAULTS = [
    (led_fault("swapped", 1, "other = 3"), "LED order", "fault", "LEDs 1 and 3 are exchanged"),
    *(
        pytest.param(*fault, marks=pytest.mark.slow)
        for fault in (
            (led_fault("swapped", 0, "other = 1"), "LED order", "fault", "LEDs 0 and 1 are"),
            (led_fault("dead", 2), "LED 2", "fault", "dead"),
            (led_fault("dim", 2, "share = 0.93"), "LED 2", "fault", "dead"),
            (led_fault("dim", 1, "share = 0.7"), "LED 1", "warning", "weak"),
            (led_fault("stuck_on", 0, "share = 1.0"), "ambient light", "warning", "full scale"),
            (
                "[[simulation.faults.frames]]\nkind = 'dropped'\nwhen = {probability = 0.2}",
                "frames",
                "warning",
                "lost",
            ),
            ("[simulation]\nambient = 0.3", "ambient light", "warning", "full scale"),
        )
    ),
]


@pytest.mark.parametrize(("fault", "name", "status", "finding"), FAULTS)
def test_each_fault_is_found(
    checks_of: Any, fault: str, name: str, status: str, finding: str
) -> None:
    checks = checks_of(fault)
    assert checks[name].status == status
    assert finding in checks[name].seen
    assert checks[name].advice


def test_a_sequence_that_is_too_long_for_the_controller_is_a_fault(checks_of: Any) -> None:
    text = SMALL + f"synchronisation = 'strobe'\ntilts_deg = {[24 * n for n in range(15)]}\n"
    checks = checks_of(text=text)
    assert checks["LEDs"].status == "ok"
    assert checks["light controller"].status == "fault"
    assert "more than 64 bytes" in checks["light controller"].seen


def test_a_failing_camera_does_not_prevent_the_other_checks(checks_of: Any) -> None:
    checks = checks_of("[[simulation.faults.frames]]\nkind = 'gone'")
    assert checks["watchdog"].status == "ok"
    assert checks["camera"].status == "fault"
    assert checks["light images"].status == "fault"


def test_a_missing_controller_does_not_prevent_the_camera_checks(checks_of: Any) -> None:
    text = (
        "[lights]\nport = '/dev/ttyNONE'\n"
        "[camera]\nkind = 'v4l2'\ndevice = '/dev/video-none'\npixel_format = 'GREY'\n"
    )
    checks = checks_of(text=text)
    assert checks["port"].status == "fault"
    assert checks["light controller"].status == "fault"
    assert checks["camera.device"].status == "fault"
    assert checks["camera"].status == "fault"
    assert checks["light images"].status == "unknown"


def test_an_unknown_surface_is_one_fault(checks_of: Any) -> None:
    checks = checks_of("[simulation.placement]\nsurface = 'no-such-folder'\n")
    assert checks["simulation"].status == "fault"
    assert "no-such-folder" in checks["simulation"].seen


def test_a_slow_camera_is_checked_with_fewer_frames() -> None:
    config = RigConfig().with_changes(
        camera={"width_px": 16, "height_px": 16, "frame_rate_hz": 0.5},
        lights={"watchdog_ms": 60_000},
    )
    with open_rig(config) as rig:
        began_s = rig.clock.now_s()
        rate, frames = check_frames(rig.camera)
        assert (rate.status, frames.status) == ("ok", "ok")
        assert rig.clock.now_s() - began_s < 25.0


def test_devices_are_listed_without_a_configuration(tmp_path: Path) -> None:
    names = [check.name for check in diagnose(tmp_path / "none.toml")]
    assert names[0] == "configuration"
    assert "ModemManager" in names


def test_the_leds_are_out_when_the_generator_ends_or_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Watched(doctor_module.Simulation):  # type: ignore[misc]
        def close(self) -> None:
            now_s = self.clock.now_s()
            lit.append(max(self.board.output(led, now_s) for led in range(4)))
            super().close()

    lit: list[float] = []
    monkeypatch.setattr(doctor_module, "Simulation", Watched)
    config = tmp_path / "rig.toml"
    config.write_text(SMALL)
    for _ in diagnose(config):
        pass
    checks = diagnose(config)
    while next(checks).name != "watchdog":
        pass
    checks.close()
    assert lit == pytest.approx([0.0, 0.0], abs=1e-3)


def test_a_broken_watchdog_is_a_fault(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock) as lights:
        assert lights.trips_watchdog()
        assert lights.state().led is None
    # The controller's time stands still while this clock advances.
    with LightController(bench.port, clock=VirtualClock()) as lights:
        checks = {c.name: c for c in check_lights(lights, bench.clock, RigConfig().lights)}
        assert checks["watchdog"].status == "fault"


def test_a_watchdog_test_that_is_refused_restores_the_watchdog_time(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock, watchdog_ms=60_000) as lights:
        for _ in range(2):
            lights.select(0)
            bench.clock.sleep_s(35.0)
        lights.off()
        with pytest.raises(LightControllerError, match="LED must rest"):
            lights.trips_watchdog()
        assert lights.ask("SYST:WDOG?", 1).numbers == (60_000,)


def test_switch_latency_is_measured_on_the_rigs_clock() -> None:
    clock = VirtualClock()
    board = SimulatedBoard(clock)
    with (
        serve_pty(SimulatedController(board, clock, link_delay_ms=12.0)) as server,
        LightController(server.address, clock=clock) as lights,
    ):
        assert switch_latencies_ms(lights, clock, switches=7) == pytest.approx([12.0] * 7)
        *_, check = check_lights(lights, clock, RigConfig().lights)
        assert check.status == "warning"
        assert "latency_timer" in check.advice
        assert lights.state().led is None


def test_old_firmware_is_a_warning(bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.doctor.devices.FIRMWARE_VERSION", "99.0")
    with LightController(bench.port, clock=bench.clock) as lights:
        check, count, *_ = check_lights(
            lights,
            bench.clock,
            RigConfig().lights.model_copy(update={"tilts_deg": (0.0,) * 5}),
        )
    assert (check.status, check.advice) == ("warning", "ps4rig rig flash")
    assert count.status == "fault"


def test_a_port_in_use_is_named_with_its_program(monkeypatch: pytest.MonkeyPatch) -> None:
    master, slave = os.openpty()
    name = os.ttyname(slave)
    pid = os.getpid()
    assert {check.name: check.status for check in check_port(name)}["port in use"] == "ok"
    # From here on this process counts as another program.
    monkeypatch.setattr("rig.doctor.devices.os.getpid", lambda: -1)
    checks = {check.name: check for check in check_port(name)}
    assert checks["permission"].status == "ok"
    assert checks["port in use"].status == "fault"
    assert f"(process {pid})" in checks["port in use"].seen
    os.close(slave)
    os.close(master)
    assert [check.status for check in check_port("socket://127.0.0.1:1")] == ["ok"]


def test_a_missing_permission_is_named_with_group_and_rule(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = tmp_path / "ttyACM0"
    port.touch(mode=0o060)
    # The superuser may read and write every file.
    monkeypatch.setattr("rig.doctor.devices.os.access", lambda *_: False)
    for groups, is_own in (([], False), ([port.stat().st_gid], True)):
        monkeypatch.setattr("rig.doctor.devices.os.getgroups", lambda own=groups: own)
        check, *_ = check_port(str(port))
        assert check.status == "fault"
        assert "belongs to group" in check.seen
        assert ("usermod -aG" in check.advice) == (not is_own)
        assert ("one of yours" in check.seen) == is_own
        assert str(RULES_FILE) in check.advice


def test_the_udev_rules_are_installed_and_sorted_before_uaccess() -> None:
    rules = RULES_FILE.read_text()
    assert RULES_FILE.name < "73-seat-late.rules"
    assert 'ENV{ID_MM_DEVICE_IGNORE}="1", TAG+="uaccess"' in rules
    assert all(vendor in rules for vendor in _VENDORS)


def test_compiled_kernels_that_are_not_kept_are_a_warning(tmp_path: Path) -> None:
    assert check_kernel_cache(tmp_path).seen == f"are kept in {tmp_path}"
    missing = check_kernel_cache(None)
    assert missing.status == "warning"
    assert "NUMBA_CACHE_DIR" in missing.advice


def test_modem_manager_without_the_udev_rules_is_a_warning(tmp_path: Path) -> None:
    proc, rules = tmp_path / "proc", tmp_path / "rules.d"
    (proc / "17").mkdir(parents=True)
    rules.mkdir()
    (proc / "17" / "comm").write_text("systemd\n")
    assert check_modem_manager(proc, [rules]).status == "ok"
    (proc / "17" / "comm").write_text("ModemManager\n")
    check = check_modem_manager(proc, [rules])
    assert check.status == "warning"
    assert "udevadm control --reload" in check.advice
    (rules / RULES_FILE.name).touch()
    assert check_modem_manager(proc, [rules]).status == "ok"


def test_ports_are_listed_with_usb_id_and_names() -> None:
    ports = [
        SerialPort("/dev/ttyS0"),
        SerialPort("/dev/ttyACM0", "2e8a:0005", "E66", "Board in FS mode", "/dev/serial/by-id/x"),
    ]
    first, second = check_ports(ports, is_simulated=False)
    assert "not known" in first.seen
    assert "2e8a:0005, serial number E66" in second.seen
    assert "also /dev/serial/by-id/x" in second.seen
    *_, last = check_ports(ports[:1], is_simulated=False)
    assert last.status == "warning"
    assert len([*check_ports(ports[:1], is_simulated=True)]) == 1


def test_cameras_are_listed_with_their_formats(tmp_path: Path) -> None:
    node = tmp_path / "video0"
    node.touch()
    formats = tuple(f"F{n} 640x480" for n in range(8))
    listed = [
        ListedCamera("v4l2", str(node), "Camera", "uvcvideo", node, formats),
        ListedCamera("v4l2", "video2", problem="video2: no permission"),
    ]
    config = V4l2CameraConfig(device=str(node))
    first, second, permission = check_cameras(listed, config)
    assert "F0 640x480" in first.seen
    assert "and 2 more formats" in first.seen
    assert second.status == "warning"
    assert permission.status == "ok"
    *_, missing = check_cameras(listed, V4l2CameraConfig(device="/dev/video9"))
    assert (missing.name, missing.status) == ("camera.device", "fault")


def test_the_range_of_the_exposure_respects_frame_and_camera(tmp_path: Path) -> None:
    node = tmp_path / "video0"
    node.touch()
    listed = [ListedCamera("v4l2", str(node), node=node, longest_exposure_ms=20.0)]
    config = V4l2CameraConfig(device=str(node))
    with open_rig(RigConfig().with_changes(camera={"width_px": 16, "height_px": 16})) as rig:
        assert exposure_range_ms(rig.camera, listed, config)[1] == 20.0
        assert exposure_range_ms(rig.camera, [], config)[1] == pytest.approx(33.33, abs=0.01)
        assert exposure_range_ms(rig.camera, listed, rig.config.camera)[1] > 33.0


@pytest.fixture(scope="module")
def images() -> Iterator[LightImages]:
    config = RigConfig().with_changes(camera={"width_px": 160, "height_px": 160})
    with open_rig(config) as rig:
        yield capture_light_images(rig)
        assert rig.lights.state().led is None


def checked(
    images: LightImages,
    lights: Any,
    lighting: Lighting | None = None,
    range_ms: tuple[float, float] = (0.1, 33.0),
) -> dict[str, Check]:
    """Check other light images with the ambient image of `images`."""
    changed = LightImages(images.ambient, lights.astype(np.uint16), images.full_scale)
    checks = check_light_images(changed, lighting or Lighting.ring(), 20.0, range_ms)
    return {check.name: check for check in checks}


def scaled(images: LightImages, scale: float) -> Any:
    black = float(images.ambient.min())
    return np.clip((images.lights - black) * scale + black, 0, images.full_scale)


def test_the_suggested_exposure_does_not_saturate(images: LightImages) -> None:
    dim = checked(images, scaled(images, 0.25), range_ms=(0.1, 200.0))
    assert dim["exposure"].status == "warning"
    wanted_ms = float(dim["exposure"].advice.rpartition("= ")[2])
    again = checked(images, scaled(images, 0.25 * wanted_ms / 20.0))
    assert again["exposure"].status == "ok"
    assert "at 80%" in again["exposure"].seen
    assert again["saturation"].status == "ok"


def test_the_suggested_exposure_fits_into_a_frame(images: LightImages) -> None:
    advice = checked(images, scaled(images, 0.25))["exposure"].advice
    assert advice.startswith("set camera.exposure_ms = 33,")
    # 16.7 ms would not fit at 60 Hz.
    advice = checked(images, scaled(images, 0.25), range_ms=(0.1, 16.6667))["exposure"].advice
    assert advice.startswith("set camera.exposure_ms = 16.6,")


def test_no_exposure_is_suggested_where_it_is_fixed(images: LightImages) -> None:
    for scale, advice in ((0.25, "brighter LEDs"), (4.0, "dim the LEDs")):
        exposure = checked(images, scaled(images, scale), range_ms=(20.0, 20.0))["exposure"]
        assert exposure.advice.startswith(f"the exposure is fixed: {advice}")


def test_saturation_is_a_fault_and_suggests_a_shorter_exposure(images: LightImages) -> None:
    bright = checked(images, scaled(images, 4.0))
    assert bright["saturation"].status == "fault"
    assert bright["exposure"].advice.startswith("set camera.exposure_ms = 8,")


def test_unequal_led_levels_are_suggested_as_lights_intensities(images: LightImages) -> None:
    assert checked(images, images.lights)["LED levels"].status == "ok"
    levels = np.array([1.0, 0.8, 1.0, 1.0])
    dark = images.ambient.astype(np.float64)
    lit = np.rint((images.lights - dark) * levels[:, None, None] + dark)
    unequal = checked(images, lit)["LED levels"]
    assert unequal.status == "warning"
    suggested = [float(level) for level in unequal.advice.partition("[")[2].rstrip("]").split(",")]
    np.testing.assert_allclose(suggested, levels, atol=0.01)
    corrected = Lighting(Lighting.ring().directions, np.array(suggested))
    assert checked(images, lit, corrected)["LED levels"].status == "ok"


def test_the_order_is_unknown_on_a_flat_part_and_with_three_leds(images: LightImages) -> None:
    flat = np.full_like(images.lights, 2000)
    assert checked(images, flat)["LED order"].status == "unknown"
    three = Lighting.ring(tilts_deg=(0.0, 120.0, 240.0))
    assert checked(images, images.lights[:3], three)["LED order"].status == "unknown"


def test_leds_that_are_all_shifted_by_one_are_named(images: LightImages) -> None:
    order = checked(images, images.lights[[1, 2, 3, 0]])["LED order"]
    assert order.status == "fault"
    assert "1 is where 0 should be" in order.seen


def test_a_silent_controller_is_one_fault(checks_of: Any) -> None:
    lost = "[[simulation.faults.lines]]\nkind = 'lose'\ndirection = 'to_host'"
    checks = checks_of(lost, timeouts=LinkTimeouts(open_s=0.1))
    assert checks["light controller"].status == "fault"
    assert checks["frame rate"].status == "ok"
    assert checks["light images"].status == "unknown"
