"""``ps4rig rig preview``."""

from typing import Annotated

import typer

from capture.commands import options
from capture.console import out, reported

_PORT = 8765


@reported
def preview(
    rig: options.Rig = "rig.toml",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page; 0 chooses a free one.")
    ] = _PORT,
) -> None:
    """Show live images under each LED on a page of this machine.

    Each image has a histogram, saturated pixels in red, a focus score and its age; an image that is
    too old is blanked. Errors of the rig are shown, and the rig is opened again. Ctrl-C ends the
    preview and switches the LEDs off.
    """
    import threading

    from capture.preview.loop import Preview, run_preview
    from capture.preview.server import serving
    from rig.config.rig import config_of

    config = config_of(rig)
    shown = Preview()
    with serving(shown, port) as server:
        out.print(f"{server.url} shows the rig; Ctrl-C ends it", soft_wrap=True)
        out.file.flush()
        run_preview(config, shown, threading.Event())
