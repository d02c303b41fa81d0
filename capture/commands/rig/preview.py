"""``ps4rig rig preview``."""

from pathlib import Path
from typing import Annotated

import typer

from capture.base.console import out, reported
from capture.commands import options
from classify.base.errors import InputError


@reported
def preview(
    rig: options.Rig = "rig.toml",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page; 0 chooses a free one.")
    ] = options.PREVIEW_PORT,
    outline: Annotated[
        Path | None,
        typer.Option(
            metavar="SET",
            help="Draw the outline of the part in this set over the images, and say at which "
            "orientation the part lies now.",
        ),
    ] = None,
    turn_to: Annotated[
        float | None,
        typer.Option(
            metavar="DEG", help="Orientation at which the outline is drawn; without it, as in SET."
        ),
    ] = None,
) -> None:
    """Show live images under each LED on a page of this machine, as the LEDs stand.

    Each image has a histogram, saturated pixels in red, a focus score and its age; an image that is
    too old is blanked. Errors of the rig are shown, and the rig is opened again. Ctrl-C ends the
    preview and switches the LEDs off.
    """
    import threading
    from functools import partial

    from capture.session.live_view import PlacementGuide
    from capture.session.preview_loop import Preview, run_preview
    from capture.session.preview_server import serving
    from rig.config.rig import config_of

    config = config_of(rig)
    shown, measure = Preview(), None
    if turn_to is not None and (outline is None or not -360.0 <= turn_to <= 360.0):
        raise InputError(
            f"--turn-to {turn_to:g}: give degrees from -360 to 360, with --outline SET"
        )
    if outline is not None:
        guide = PlacementGuide.of(outline, turn_to)
        shown.guide(f"turn to {guide.asked_deg:g} degrees", guide.outline)
        measure = partial(guide.orientation_text, config.lights.lighting)
    with serving(shown, port) as server:
        out.print(f"{server.url} shows the rig; Ctrl-C ends it")
        out.file.flush()
        run_preview(config, shown, threading.Event(), measure)
