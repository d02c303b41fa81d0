"""Scanned materials in a folder of material folders."""

from pathlib import Path

from capture.chapter import plan as chapter
from capture.chapter.plan import Texture
from classify.base.errors import InputError

_MATERIAL_MAPS = ("height.png", "normal.png", "normal.jpg")


def material_textures(folder: Path | None) -> tuple[Texture, ...]:
    """The material folders in `folder`, by default the bundled ones.

    Raises
    ------
    InputError
        If there are fewer than two.
    """
    if folder is None:
        return chapter.material_textures()
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give one that holds material folders")
    found = tuple(
        Texture(path.name, path.absolute())
        for path in sorted(folder.iterdir())
        if any((path / name).is_file() for name in _MATERIAL_MAPS)
    )
    if len(found) < 2:
        raise InputError(
            f"{folder}: holds {len(found)} material folders; give at least two, each with a "
            "height.png or a normal.png"
        )
    return found
