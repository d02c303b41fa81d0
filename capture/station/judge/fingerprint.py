"""`Fingerprint`: hashes of everything that a verdict depends on, except the part."""

import hashlib
import platform
from collections.abc import Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Self

from capture.calibration.lookup import FoundCalibration
from capture.station.domain.recipe import Recipe
from capture.station.domain.taught import Taught
from classify.base.models import Record

HOME = Path(__file__).parents[3]
_PACKAGES = ("capture", "classify", "firmware_sim", "rig")
# Packages that compute the measures. `opencv-python-headless` is cv2.
_COMPUTING = ("numpy", "scipy", "numba", "opencv-python-headless", "tifffile")


@cache
def software_sha256() -> str:
    """SHA-256 of this program, with Python and packages; computed once in a process."""
    digest = hashlib.sha256()
    for name, number in (("python", platform.python_version()), *_versions()):
        digest.update(f"{name} {number}\n".encode())
    for package in _PACKAGES:
        for path in sorted((HOME / package).rglob("*.py")):
            source = path.read_bytes()
            digest.update(f"{path.relative_to(HOME).as_posix()} {len(source)}\n".encode())
            digest.update(source)
    return digest.hexdigest()


def _versions() -> Iterator[tuple[str, str]]:
    for name in _COMPUTING:
        try:
            yield name, version(name)
        except PackageNotFoundError:  # cv2 of another distribution
            yield name, "unknown"


class Fingerprint(Record):
    """Hashes of everything that a verdict depends on, except the part."""

    recipe_sha256: str
    library_sha256: str
    defects_sha256: tuple[str, ...]
    pieces_sha256: tuple[str, ...]
    calibration_sha256: str | None
    software_version: str
    software_sha256: str

    @classmethod
    def of(cls, recipe: Recipe, taught: Taught, calibration: FoundCalibration | None) -> Self:
        """Return the hashes of a recipe, of what was taught for it, and of a calibration."""
        textures = [taught.textures[name] for name in recipe.passes]
        return cls(
            recipe_sha256=recipe.sha256,
            library_sha256=taught.library_sha256,
            defects_sha256=tuple(texture.defects_sha256 or "" for texture in textures),
            pieces_sha256=tuple(texture.pieces_sha256 or "" for texture in textures),
            calibration_sha256=None if calibration is None else calibration.file.hash,
            software_version=version("ps4rig"),
            software_sha256=software_sha256(),
        )
