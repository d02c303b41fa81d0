"""All checks of a rig, one after the other."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from types import MappingProxyType

from classify.base.compiling import kernel_cache_folder
from classify.base.errors import ConfigError, Ps4rigError
from rig.cameras.camera import Camera, CameraInfo, ListedCamera
from rig.cameras.kinds import list_cameras
from rig.config.rig import RigConfig, config_of
from rig.errors import ControlError, HardwareError
from rig.lights.discovery import list_serial_ports
from rig.lights.driver import LightController
from rig.lights.link import DEFAULT_TIMEOUTS, LinkTimeouts
from rig.lights.sequence import require_short_command
from rig.rig import Rig, clock_of, open_camera, open_lights, port_of
from rig.simulation.rig import Simulation

from .check import Check, run_checks
from .devices import (
    check_cameras,
    check_controls,
    check_frames,
    check_lights,
    check_modem_manager,
    check_port,
    check_ports,
    exposure_range_ms,
)
from .light_images import capture_light_images, check_light_images


def diagnose(
    rig: str | Path,
    timeouts: LinkTimeouts = DEFAULT_TIMEOUTS,
    more_checks: Callable[[Rig], Iterator[Check]] | None = None,
    camera: Mapping[str, float] = MappingProxyType({}),
) -> Generator[Check]:
    """Make all checks, `more_checks` of the open rig last; a failed check prevents no other.

    The settings `camera` replace those of the configuration.
    """
    config: RigConfig | None = None
    try:
        config = config_of(rig).with_changes(camera=dict(camera))
    except ConfigError as error:
        advice = "ps4rig rig init writes one with all keys"
        yield Check("configuration", "fault", str(error), advice)
    else:
        lights = "simulated" if config.is_simulated else f"at {config.lights.port}"
        finding = f"rig name {config.name!r}, lights {lights}, camera {config.camera.kind}"
        yield Check("configuration", "ok", finding)
    yield from run_checks(
        "serial ports",
        lambda: check_ports(list_serial_ports(), config is not None and config.is_simulated),
    )
    yield check_modem_manager()
    yield check_kernel_cache(kernel_cache_folder())
    cameras: list[ListedCamera] = []

    def find_cameras() -> Iterator[Check]:
        cameras.extend(list_cameras())
        yield from check_cameras(cameras, None if config is None else config.camera)

    yield from run_checks("cameras", find_cameras)
    if config is not None:
        with ExitStack() as closing:
            yield from _diagnose_open(config, cameras, closing, timeouts, more_checks)


def check_kernel_cache(folder: Path | None) -> Check:
    """Check that compiled kernels are kept between commands."""
    if folder is not None:
        return Check("compiled kernels", "ok", f"are kept in {folder}")
    finding = "are not kept, since no folder can be written: each command compiles them for seconds"
    advice = "set the environment variable NUMBA_CACHE_DIR to a folder that you may write to"
    return Check("compiled kernels", "warning", finding, advice)


def _diagnose_open(
    config: RigConfig,
    cameras: Sequence[ListedCamera],
    closing: ExitStack,
    timeouts: LinkTimeouts,
    more_checks: Callable[[Rig], Iterator[Check]] | None,
) -> Iterator[Check]:
    simulation = None
    if config.is_simulated:
        try:
            simulation = Simulation(config)
        except Ps4rigError as error:
            yield Check("simulation", "fault", str(error))
            return
        closing.callback(simulation.close)
    lights: LightController | None = None
    camera: Camera | None = None
    rig: Rig | None = None

    def check_controller() -> Iterator[Check]:
        nonlocal lights
        if simulation is None:
            port = port_of(config)
            yield from check_port(port)
        lights = closing.enter_context(open_lights(config, simulation, timeouts))
        yield from check_lights(lights, clock_of(simulation), config.lights)
        if config.sequence_plan is not None:
            require_short_command(config.sequence_plan)

    def check_camera() -> Iterator[Check]:
        nonlocal camera
        try:
            camera = open_camera(config, simulation)
        except ControlError as error:
            yield from check_controls(error)
            return
        closing.callback(camera.close)
        yield _measurement_mode(camera.info)
        yield from check_frames(camera)

    def check_images() -> Iterator[Check]:
        nonlocal rig
        if lights is None or camera is None:
            yield Check("light images", "unknown", "lights or camera did not open")
            return
        with suppress(HardwareError):
            lights.recover()
        rig = Rig(config, clock_of(simulation), lights, camera, simulation)
        yield from check_light_images(
            capture_light_images(rig),
            rig.lighting,
            1e3 * camera.info.exposure_s,
            exposure_range_ms(camera, cameras, config.camera),
        )

    yield from run_checks("light controller", check_controller)
    yield from run_checks("camera", check_camera)
    yield from run_checks("light images", check_images)
    if more_checks is not None and rig is not None:
        yield from run_checks("calibration", partial(more_checks, rig))


def _measurement_mode(info: CameraInfo) -> Check:
    finding = (
        f"{info.name}: {info.width_px} x {info.height_px} px of {info.bit_depth} bit, exposure "
        f"{1e3 * info.exposure_s:g} ms; all controls were set and read back"
    )
    return Check("measurement mode", "ok", finding)
