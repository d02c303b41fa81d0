"""Write light directions as an RTI ``.lp`` file or as JSON."""

import json
from collections.abc import Sequence
from pathlib import Path

from classify import Lighting
from classify.durable_file import durable_file
from classify.errors import InputError


def require_light_list_name(path: Path) -> None:
    """Raise `InputError` if the name of a list of lights has another ending."""
    if path.suffix.lower() not in (".lp", ".json"):
        raise InputError(f"{path}: let the name of a list of lights end in .lp or .json")


def write_light_list(path: Path, lighting: Lighting, names: Sequence[str]) -> None:
    """Write ``.lp`` with names, and intensities if known, or ``.json`` with vectors in order."""
    require_light_list_name(path)
    vectors = [[round(each, 9) for each in row] for row in lighting.directions.tolist()]
    if path.suffix.lower() == ".json":
        text = "[\n" + ",\n".join(f" {json.dumps(each)}" for each in vectors) + "\n]\n"
    else:
        rows = [[*vector] for vector in vectors]
        if lighting.intensities_given:
            rows = [
                [*vector, round(level, 6)]
                for vector, level in zip(vectors, lighting.intensities.tolist(), strict=True)
            ]
        lines = (f"{name} {' '.join(map(str, row))}" for name, row in zip(names, rows, strict=True))
        text = "\n".join([str(len(rows)), *lines]) + "\n"
    with durable_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
