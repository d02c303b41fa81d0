"""An open rig: lights, camera and one clock for both."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from classify import Lighting
from classify.base.errors import ConfigError
from firmware_sim import Clock, RealClock

from .cameras.camera import Camera
from .cameras.kinds import CAMERA_KINDS
from .config.lights import AUTO
from .config.rig import RigConfig, config_of
from .lights.discovery import (
    PossiblePorts,
    find_controller,
    known_port,
    list_serial_ports,
    list_serial_ports_if_possible,
    ports_to_try,
)
from .lights.driver import LightController
from .lights.link import DEFAULT_TIMEOUTS, LinkTimeouts
from .lights.sequence import require_short_command
from .signals import signals_held_back
from .simulation.rig import Simulation


@dataclass(frozen=True, eq=False)
class Rig:
    """An open rig; closing it puts the LEDs out.

    Leaving its `with` block in any way closes it.

    Attributes
    ----------
    config
        The rig's configuration.
    clock
        The clock of frames and acknowledgements.
    lights, camera
        The drivers.
    simulation
        The simulated hardware below the drivers, None on a real rig.
    """

    config: RigConfig
    clock: Clock
    lights: LightController
    camera: Camera
    simulation: Simulation | None

    @property
    def lighting(self) -> Lighting:
        """Directions and relative intensities of the lights."""
        return self.config.lights.lighting

    @property
    def is_simulated(self) -> bool:
        """Whether its hardware is simulated, here or by devices of `ps4rig rig simulate`."""
        return self.simulation is not None or self.lights.identity.is_simulated

    def close(self) -> None:
        """Put the LEDs out and release everything; a second call does nothing.

        Signals that would end the program are delivered afterwards.
        """
        with signals_held_back():
            try:
                self.lights.close()
            finally:
                self.camera.close()
                if self.simulation is not None:
                    self.simulation.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_rig(rig: str | Path | RigConfig, *, timeouts: LinkTimeouts = DEFAULT_TIMEOUTS) -> Rig:
    """Open a rig.

    Parameters
    ----------
    rig
        ``"sim"`` for the simulated rig, the path of a ``rig.toml``, or a `RigConfig`.
    timeouts
        How long to wait for the light controller.

    Raises
    ------
    ConfigError
        If the configuration cannot be used.
    HardwareError
        If the light controller or the camera cannot be opened.

    Examples
    --------
    >>> with open_rig("sim") as rig:
    ...     switch = rig.lights.select(2)
    ...     frame = rig.camera.read(timeout_s=1.0)
    >>> switch.led, frame.bit_depth
    (2, 12)
    """
    config = rig if isinstance(rig, RigConfig) else config_of(rig)
    if config.sequence_plan is not None:
        require_short_command(config.sequence_plan)
    with ExitStack() as closing:
        simulation = None
        if config.is_simulated:
            simulation = Simulation(config)
            closing.callback(simulation.close)
        lights = closing.enter_context(open_lights(config, simulation, timeouts))
        if lights.led_count < len(config.lights.tilts_deg):
            raise ConfigError(
                f"lights.tilts_deg names {len(config.lights.tilts_deg)} LEDs, the controller "
                f"at {lights.port} has {lights.led_count}; give the tilts of its LEDs"
            )
        opened = Rig(
            config, clock_of(simulation), lights, open_camera(config, simulation), simulation
        )
        closing.pop_all()  # from here on the rig closes them
    return opened


def open_lights(
    config: RigConfig, simulation: Simulation | None, timeouts: LinkTimeouts = DEFAULT_TIMEOUTS
) -> LightController:
    """Open the light controller of a rig, and keep its watchdog quiet from then on."""
    port = port_of(config) if simulation is None else simulation.port
    lights = LightController(
        port,
        clock=clock_of(simulation),
        baud=config.lights.baud,
        watchdog_ms=config.lights.watchdog_ms,
        possible_ports=_possible_ports(port, simulation),
        timeouts=timeouts,
    )
    if simulation is not None and config.simulation.clock == "virtual":
        simulation.clock.keep_alive_with(lights.keep_alive_if_due)
    else:
        lights.keep_alive()
    return lights


def clock_of(simulation: Simulation | None) -> Clock:
    """Return the clock of frames and acknowledgements."""
    return RealClock() if simulation is None else simulation.clock


def port_of(config: RigConfig) -> str:
    """Return the port of a real rig's light controller, see `find_controller`."""
    if config.lights.port != AUTO:
        return config.lights.port
    return find_controller(config.lights, list_serial_ports())


def _possible_ports(port: str, simulation: Simulation | None) -> PossiblePorts:
    """Return a function that lists the ports on which a lost controller may be now."""
    if simulation is not None:
        return lambda: simulation.ports
    previous = known_port(port, list_serial_ports_if_possible())
    return lambda: ports_to_try(previous, list_serial_ports_if_possible())


def open_camera(config: RigConfig, simulation: Simulation | None) -> Camera:
    """Open the camera of a rig."""
    opener = CAMERA_KINDS[config.camera.kind].opener
    if opener is not None:
        return opener(config.camera)
    if simulation is None:
        raise ConfigError(
            f"camera.kind = {config.camera.kind!r} cannot see the LEDs at {config.lights.port}; a "
            "simulated camera needs lights.port = 'simulated', a real one camera.kind = 'v4l2'"
        )
    return simulation.camera_with_faults
