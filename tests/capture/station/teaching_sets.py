"""Captured sets for tests of teaching: small patches of simulated textures."""

from contextlib import AbstractContextManager
from pathlib import Path
from unittest import mock

import numpy as np

from capture import CapturedSet, capture_set
from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from capture.station.judge.fault_study import FAULTS
from classify.defects import detectability
from rig import RigConfig, open_rig

# The smallest frame that a defect model learns from.
SIDE_PX = 256


def few_places() -> AbstractContextManager[object]:
    """Teach faster: strengths that are found are tested in `tests/classify/defects`."""
    return mock.patch.multiple(detectability, _MIN_PLACES=4, _MAX_PLACES=4)


def acknowledge_faults(files: RecipeFolder) -> None:
    """Let a recipe from so few parts be approved, whatever made faults pass it."""
    kinds = tuple(fault.name for fault in FAULTS)
    write_recipe(files.file, read_recipe(files.file).model_copy(update={"acknowledged": kinds}))


def patch(surface: str, number: int, side_px: int = SIDE_PX, **placement: object) -> CapturedSet:
    """Capture one patch of a surface, at its own place, orientation and noise."""
    draw = np.random.default_rng([number, *surface.encode()])
    placed = {
        "surface": surface,
        "seed": number + 1,
        "rotate_deg": float(draw.uniform(0.0, 360.0)),
        "shift_px": tuple(draw.uniform(0.0, 400.0, 2).tolist()),
    }
    config = RigConfig().with_changes(
        camera={"width_px": side_px, "height_px": side_px},
        simulation={"placement": placed | placement},
    )
    with open_rig(config) as rig:
        return capture_set(rig, label=surface)


def saved(
    folder: Path, surface: str, numbers: range, side_px: int = SIDE_PX, **placement: object
) -> list[Path]:
    """Capture patches into files."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{surface}-{number}.ome.tif" for number in numbers]
    for path, number in zip(paths, numbers, strict=True):
        patch(surface, number, side_px, **placement).save(path)
    return paths
