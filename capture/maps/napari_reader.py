"""The reader that napari calls for captured sets and folders of maps; ps4rig needs no napari."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from capture.sets import ome_tiff
from classify.base.arrays import Array
from classify.base.errors import InputError

from .map_tiff import read_description, read_map

# Values, arguments of the layer, and its kind, as napari asks for.
_Layer = tuple[Array, dict[str, Any], str]
_Reader = Callable[[str], list[_Layer]]
# Pages and maps with two values are label layers; the others are image layers.
_MASK_PAGE = "mask"
_SHOWN_MAP = "albedo"


def get_reader(path: str | list[str]) -> _Reader | None:
    """Return a reader for a captured set or a folder of maps, or None for anything else."""
    if not isinstance(path, str):  # sets may differ in size and lights: they are not stacked
        return None
    try:
        if Path(path).is_dir():
            read_description(Path(path) / "p.tif")  # every folder of maps has it
            return _read_map_layers
        ome_tiff.read_header(Path(path))
    except InputError:
        return None
    return _read_set_layers


def _read_set_layers(path: str) -> list[_Layer]:
    """Read the pages of a captured set as layers with its metadata; only the first is visible."""
    images, ambient, metadata, mask = ome_tiff.read(Path(path))
    pages = [*images] + [page for page in (ambient, mask) if page is not None]
    description = metadata.model_dump(mode="json")
    return [
        _layer(
            name,
            page,
            description,
            (0, metadata.full_scale),
            is_mask=name == _MASK_PAGE,
            is_visible=index == 0,
        )
        for index, (name, page) in enumerate(zip(ome_tiff.page_names(metadata), pages, strict=True))
    ]


def _read_map_layers(path: str) -> list[_Layer]:
    """Read the maps in a folder as layers with their descriptions; only the albedo is visible."""
    from .map_kinds import MAP_KINDS  # here, since a set is read without a solver
    from .views import YES_NO

    masks = {name for name, kind in MAP_KINDS.items() if kind.labels is YES_NO}
    layers = []
    for file in sorted(Path(path).glob("*.tif")):
        try:
            read_description(file)
        except InputError:  # a file of someone else
            continue
        values, description = read_map(file)
        channels = values if values.ndim == 3 else values[None]
        names = [file.stem] if values.ndim == 2 else [f"{file.stem} {axis}" for axis in "xyz"]
        for name, channel in zip(names, channels, strict=True):
            layer = _layer(
                name,
                channel,
                description,
                None,
                is_mask=name in masks,
                is_visible=name == _SHOWN_MAP,
            )
            layers.append(layer)
    return layers


def _layer(
    name: str,
    values: Array,
    description: dict[str, Any],
    limits: tuple[float, float] | None,
    *,
    is_mask: bool,
    is_visible: bool,
) -> _Layer:
    arguments: dict[str, Any] = {
        "name": name,
        "visible": is_visible,
        "metadata": {"ps4rig": description},
    }
    mm_per_px = description.get("mm_per_px")
    if mm_per_px is not None:
        arguments |= {"scale": (mm_per_px, mm_per_px), "units": ("mm", "mm")}
    if is_mask:
        return (values > 0).astype("u1"), arguments, "labels"
    if limits is not None:
        arguments["contrast_limits"] = limits
    return values, arguments, "image"
