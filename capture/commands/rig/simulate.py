"""``ps4rig rig simulate``."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import out, reported
from capture.commands import options
from classify.base.errors import InputError

if TYPE_CHECKING:
    from rig.simulation.devices import DeviceSimulation

_REPORT_EVERY_S = 5.0


@reported
def simulate(
    rig: options.Rig = "sim",
    serial: Annotated[
        str | None,
        typer.Option(
            help="Serial device on which the firmware answers: this machine's end of a USB gadget "
            "or of a null modem. Without it a pseudo-terminal is made.",
            metavar="DEV",
        ),
    ] = None,
    video: Annotated[
        str | None, typer.Option(help="v4l2loopback device for the camera's frames.", metavar="DEV")
    ] = None,
    gige: Annotated[
        str | None,
        typer.Option(
            help="Address of this machine at which a GigE Vision camera, Aravis-Fake-SIM-0001, "
            "sends the frames; needs Aravis.",
            metavar="ADDRESS",
        ),
    ] = None,
    surface: options.Surface = None,
    rotate: Annotated[
        float | None,
        typer.Option(
            help="Orientation of the surface in degrees, anticlockwise.",
            rich_help_panel=options.SIMULATION,
            metavar="DEG",
        ),
    ] = None,
    slant: options.Slant = None,
    shift_px: options.ShiftPx = None,
    seed: options.Seed = None,
    bits: options.Bits = None,
    size: options.Size = None,
) -> None:
    """Simulate a rig as devices: the firmware on a serial line, and a camera.

    Runs until Ctrl-C. Only the controller's serial number, SIM-0001, distinguishes it from a real
    one; sets that ps4rig captures from it are marked as simulated.
    """
    if serial is None and video is None and gige is None:
        raise InputError(
            "give --serial DEV, where the firmware answers; --video DEV, a v4l2loopback device "
            "for the frames (modprobe v4l2loopback makes one); or --gige ADDRESS"
        )
    if video is not None and gige is not None:
        raise InputError("give --video DEV or --gige ADDRESS: a rig has one camera")
    from rig.config.rig import config_of
    from rig.simulation.devices import DeviceSimulation

    placement = {"surface": surface, "rotate_deg": rotate, "shift_px": shift_px, "seed": seed}
    config = options.with_part(config_of(rig), placement, slant, bits, size)

    simulation = DeviceSimulation(config, serial=serial, video=video, gige=gige)
    try:
        out.print(f"lights: {simulation.port}")
        if simulation.writes_frames:
            camera = config.camera
            out.print(
                f"camera: {video or gige}, {simulation.pixel_format} "
                f"{camera.width_px}x{camera.height_px}, {camera.frame_rate_hz:g} Hz, "
                f"exposure {camera.exposure_ms:g} ms",
            )
        sys.stdout.flush()
        _run(simulation)
    except KeyboardInterrupt:
        print(_status(simulation), file=sys.stderr)  # Ctrl-C is the normal end
    finally:
        simulation.close()


def _run(simulation: DeviceSimulation) -> None:
    next_report_s = time.monotonic()
    while True:
        simulation.step()
        if sys.stderr.isatty() and time.monotonic() >= next_report_s:
            next_report_s += _REPORT_EVERY_S
            print(_status(simulation), file=sys.stderr)


def _status(simulation: DeviceSimulation) -> str:
    lit = ", ".join(f"LED {led}" for led in simulation.lit) or "no LED"
    if not simulation.writes_frames:
        return f"{lit} lit"
    return f"{lit} lit, {simulation.written} frames written, {simulation.late} too late"
