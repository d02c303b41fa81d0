"""Commands that make and solve captured sets: capture, import, solve."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from classify import METHODS, Lighting, Method
from classify.errors import InputError
from rig import ConfigError, Placement, Rig, RigConfig, load_config, open_rig, surface_names

from .acquisition import MAX_AVERAGE, capture_set
from .captured_set import CapturedSet
from .console import JsonOption, naming, out, print_json, progress, reported
from .image_import import Gamma, import_images
from .light_list import load_light_list
from .maps import write_maps
from .set_file import SUFFIX, check_path

__all__ = ["capture", "import_", "solve"]

SIMULATION = "With a simulated rig"


@reported
def capture(
    output: Annotated[Path, typer.Argument(metavar="OUT", help="File to write, NAME.ome.tif.")],
    rig: Annotated[
        str, typer.Option(help="'sim' for the simulated rig, or a rig.toml.", metavar="RIG")
    ] = "rig.toml",
    label: Annotated[str | None, typer.Option(help="Class of the part.")] = None,
    average: Annotated[int, typer.Option(min=1, max=MAX_AVERAGE, help="Frames per image.")] = 1,
    count: Annotated[int, typer.Option(min=1, max=9999, help="Sets in a row.")] = 1,
    surface: Annotated[
        str | None,
        typer.Option(
            help=f"A material folder, or one of {', '.join(surface_names())}.",
            rich_help_panel=SIMULATION,
            metavar="NAME|DIR",
        ),
    ] = None,
    rotate: Annotated[
        list[float] | None,
        typer.Option(
            help="Degrees the surface is turned, anticlockwise. Give it again for more sets.",
            rich_help_panel=SIMULATION,
            metavar="DEG",
        ),
    ] = None,
    slant: Annotated[
        float | None,
        typer.Option(help="Slant of the lights, degrees.", rich_help_panel=SIMULATION),
    ] = None,
    shift_px: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="Move the patch over the surface, right and up.", rich_help_panel=SIMULATION
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            help="Noise, and the realisation of a synthetic surface.", rich_help_panel=SIMULATION
        ),
    ] = None,
    bits: Annotated[
        int | None,
        typer.Option(help="Depth of the camera: 8, 10, 12, 16.", rich_help_panel=SIMULATION),
    ] = None,
    size: Annotated[
        int | None,
        typer.Option(help="Side of the frame, pixels.", rich_help_panel=SIMULATION),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Take one captured set, or several: ambient image, then each LED in order."""
    check_path(output)
    changes: dict[str, dict[str, Any]] = {"camera": {}, "lights": {}}
    placed = {"surface": surface, "shift_px": shift_px, "seed": seed}
    config = RigConfig() if rig == "sim" else load_config(Path(rig))
    placement = config.simulation.placement.model_dump()
    placement.update({name: value for name, value in placed.items() if value is not None})
    turned = [placement | {"rotate_deg": turn_deg} for turn_deg in rotate or ()] or [placement]
    if slant is not None:
        changes["lights"]["slant_deg"] = slant
    if bits is not None:
        changes["camera"]["bits"] = bits
    if size is not None:
        changes["camera"].update(width_px=size, height_px=size)
    simulated_only = (*placed.values(), rotate, slant, bits, size)
    if not config.is_simulated and any(value is not None for value in simulated_only):
        raise ConfigError(f"{rig}: --surface, --rotate and the like are for a simulated rig")
    # All are checked before the first is captured.
    configs = [config.with_changes(**changes, simulation={"placement": part}) for part in turned]
    paths = _numbered(output, len(configs) * count)
    with open_rig(configs[0]) as opened:
        placements = [each.simulation.placement for each in configs]
        sets = _captured(opened, placements, count, label, average)
        for path, captured in zip(paths, progress(sets, len(paths), "capture"), strict=True):
            captured.save(path)
            if not json:
                note = " (simulated)" if captured.metadata.simulated else ""
                out.print(f"{path}: {len(captured.images)} lights{note}", soft_wrap=True)
    if json:
        print_json([{"set": str(path), "simulated": config.is_simulated} for path in paths])


def _captured(
    rig: Rig, placements: list[Placement], count: int, label: str | None, average: int
) -> Iterator[CapturedSet]:
    for placement in placements:
        if rig.simulation is not None and rig.simulation.placement != placement:
            rig.simulation.place(placement)
        for _ in range(count):
            yield capture_set(rig, label, average=average)


def _numbered(output: Path, count: int) -> list[Path]:
    if count == 1:
        return [output]
    stem = output.name.removesuffix(SUFFIX)
    digits = max(3, len(str(count)))
    return [
        output.with_name(f"{stem}-{number:0{digits}d}{SUFFIX}") for number in range(1, count + 1)
    ]


@reported
def import_(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="IMG... OUT",
            help="Photographs, one per light, then NAME.ome.tif to write. With --lights that "
            "names its images, they may be left out.",
        ),
    ],
    tilts: Annotated[
        str | None,
        typer.Option(
            help="Tilt of the light of each image, degrees, with commas. [default: 0,90,180,270]"
        ),
    ] = None,
    slant: Annotated[
        float | None, typer.Option(help="Slant of all lights, degrees from the camera's axis.")
    ] = None,
    lights: Annotated[
        Path | None, typer.Option(help="Light vectors instead of tilts: .json or RTI .lp.")
    ] = None,
    gamma: Annotated[
        Gamma | None, typer.Option(help="How brightness is coded; needed for 8-bit JPEG.")
    ] = None,
    ambient: Annotated[Path | None, typer.Option(help="Photograph with all lights out.")] = None,
    label: Annotated[str | None, typer.Option(help="Class of the part.")] = None,
    json: JsonOption = False,
) -> None:
    """Make a captured set of existing photographs: PNG, JPEG or TIFF, 8 or 16 bit."""
    *images, output = paths
    if not output.name.endswith(SUFFIX):
        raise InputError(f"{output}: the last argument is the file to write, NAME{SUFFIX}")
    if lights is not None:
        if slant is not None or tilts is not None:
            raise InputError("--lights gives the directions; leave out --slant and --tilts")
        light_list = load_light_list(lights)
        images = images or light_list.image_paths()
        lighting = light_list.lighting_for(images)
    else:
        if slant is None:
            raise InputError("give --slant DEG of the lights, or --lights FILE")
        lighting = Lighting.from_angles(_degrees(tilts or "0,90,180,270"), slant)
    captured = import_images(images, lighting, gamma=gamma, ambient=ambient, label=label)
    captured.save(output)
    if json:
        print_json({"set": str(output), "lights": len(images)})
    else:
        out.print(f"{output}: {len(images)} lights", soft_wrap=True)


def _degrees(text: str) -> list[float]:
    try:
        degrees = [float(part) for part in text.split(",")]
    except ValueError:
        degrees = [math.nan]
    if not all(map(math.isfinite, degrees)):
        raise InputError(f"--tilts {text}: give degrees with commas, as 0,90,180,270")
    return degrees


@reported
def solve(
    captured_set: Annotated[Path, typer.Argument(metavar="SET", help="A captured set.")],
    output: Annotated[Path, typer.Option("--out", help="Folder for the maps.", metavar="DIR")],
    method: Annotated[
        str | None,
        typer.Option(
            help=f"One of {', '.join(METHODS)}. [default: ps4; more than four lights: "
            "least_squares]",
            metavar="METHOD",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Write p, q, albedo, normals, relative height, shadow and residual of a set."""
    if method is not None and method not in METHODS:
        raise InputError(f"--method {method}: choose one of {', '.join(METHODS)}")
    chosen: Method | None = method
    captured = CapturedSet.load(captured_set)
    with naming(captured_set):
        surface = captured.solve(chosen)
    written = write_maps(captured, surface, output)
    shares: dict[str, float] = {
        "valid": float(surface.valid.mean()),
        "saturated": float(surface.saturated.mean()),
        "shadowed": float(surface.shadow_mask.mean()),
    }
    if json:
        print_json(
            {
                "set": str(captured_set),
                "files": [str(path) for path in written],
                **shares,
                "simulated": captured.metadata.simulated,
            }
        )
    else:
        note = " (of a simulated set)" if captured.metadata.simulated else ""
        out.print(f"{output}: {len(written)} files{note}", soft_wrap=True)
        out.print(
            f"valid {shares['valid']:.1%}, saturated {shares['saturated']:.1%}, "
            f"in shadow of a light {shares['shadowed']:.1%} of the pixels"
        )
