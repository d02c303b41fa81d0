"""A set as a NumPy ``.npz`` file."""

from pathlib import Path

import numpy as np

from capture.sets.captured_set import CapturedSet
from classify.durable_file import durable_file


def write_numpy_file(captured: CapturedSet, path: Path) -> None:
    """Write images, ambient image, mask, lights and metadata (JSON text) under their names."""
    lighting = captured.lighting
    arrays = {
        "images": captured.images,
        "ambient": captured.ambient,
        "mask": captured.mask,
        "directions": lighting.directions,
        "intensities": lighting.intensities,
        "positions_px": lighting.positions_px,
        "metadata": np.array(captured.metadata.model_dump_json()),
    }
    present = {name: array for name, array in arrays.items() if array is not None}
    with durable_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **present)
