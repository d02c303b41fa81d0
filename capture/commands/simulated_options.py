"""The options of a simulated rig, shared by the commands that have them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rig import RigConfig

__all__ = [
    "SIMULATION",
    "BitsOption",
    "RigOption",
    "SeedOption",
    "ShiftOption",
    "SizeOption",
    "SlantOption",
    "SurfaceOption",
    "with_part",
]

SIMULATION = "With a simulated rig"
RigOption = Annotated[
    str, typer.Option(help="'sim' for the simulated rig, or a rig.toml.", metavar="RIG")
]
SurfaceOption = Annotated[
    str | None,
    typer.Option(
        help="A material folder or a name: rock, sand, malv, ogil and more. A wrong name lists "
        "them all.",
        rich_help_panel=SIMULATION,
        metavar="NAME|DIR",
    ),
]
SlantOption = Annotated[
    float | None,
    typer.Option(help="Slant of the lights in degrees.", rich_help_panel=SIMULATION),
]
ShiftOption = Annotated[
    tuple[float, float] | None,
    typer.Option(help="Shift of the patch to the right and up.", rich_help_panel=SIMULATION),
]
SeedOption = Annotated[
    int | None,
    typer.Option(help="Seed of the noise and of a synthetic surface.", rich_help_panel=SIMULATION),
]
BitsOption = Annotated[
    int | None,
    typer.Option(help="Pixel depth of the camera: 8, 10, 12 or 16.", rich_help_panel=SIMULATION),
]
SizeOption = Annotated[
    int | None,
    typer.Option(help="Side of the frame in pixels.", rich_help_panel=SIMULATION),
]


def with_part(
    config: RigConfig,
    *,
    surface: str | None,
    rotate_deg: float | None,
    shift_px: tuple[float, float] | None,
    seed: int | None,
    slant_deg: float | None,
    bits: int | None,
    size_px: int | None,
) -> RigConfig:
    """Return `config` with the given values; None keeps the value of `config`.

    Raises
    ------
    ConfigError
        If the result is not a valid configuration.
    """
    placed = {"surface": surface, "rotate_deg": rotate_deg, "shift_px": shift_px, "seed": seed}
    camera = {"bits": bits, "width_px": size_px, "height_px": size_px}
    placement = config.simulation.placement.model_dump() | _given(placed)
    return config.with_changes(
        lights=_given({"slant_deg": slant_deg}),
        camera=_given(camera),
        simulation={"placement": placement},
    )


def _given(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}
