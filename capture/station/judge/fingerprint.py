"""`Fingerprint`: hashes of everything that a verdict depends on, except the part."""

from importlib.metadata import version
from typing import Self

from capture.calibration.ps4cal import CalibrationFile
from capture.station.domain.recipe import Recipe
from capture.station.domain.taught import Taught
from classify.base.section import Record

from .software import software_sha256


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
    def of(cls, recipe: Recipe, taught: Taught, calibration: CalibrationFile | None) -> Self:
        """Return the hashes of a recipe, of what was taught for it, and of a calibration."""
        textures = [taught.textures[name] for name in recipe.passes]
        return cls(
            recipe_sha256=recipe.sha256,
            library_sha256=taught.library_sha256,
            defects_sha256=tuple(each.defects_sha256 or "" for each in textures),
            pieces_sha256=tuple(each.pieces_sha256 or "" for each in textures),
            calibration_sha256=None if calibration is None else calibration.hash,
            software_version=version("ps4rig"),
            software_sha256=software_sha256(),
        )
