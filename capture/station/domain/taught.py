"""`Taught`: measurements on the taught parts of a recipe, and the models that teaching made."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from capture.base.names import Label, Name
from capture.calibration.setting import Setting
from classify import DefectModel
from classify.base.errors import InputError
from classify.base.models import Record
from classify.pieces.piece_model import PieceModel
from rig.set_file import fields_sha256

from .errors import RecipeError
from .recipe import Recipe, Region, Sha256
from .recipe_file import RecipeFolder, TaughtFiles

# Margin on the least and largest tilt error of the taught parts. It depends on their orientation,
# by up to 1.9 degrees to either side on brushed metal, the most of 20 surfaces, and parts of one
# orientation may be taught (tests/capture/station/judge/test_tilt_error.py).
_TILT_MARGIN_DEG = 4.0
# 10,000 parts with their hashes take 2 MB.
_MAX_BYTES = 1 << 24


class DetectionLimit(Record):
    """Detection limit: the weakest defect of a kind and size that is found in 9 of 10 places."""

    kind: Literal["scratch", "dent", "stain"]
    size_px: PositiveFloat  # width of a scratch, diameter of the others
    # Depth in px, or contrast as a share of the albedo; None if the strongest is not found.
    strength: NonNegativeFloat | None
    strongest: float  # depth or contrast that was tried
    mm_per_px: PositiveFloat | None = None

    @property
    def is_stain(self) -> bool:
        """Whether its strength is a contrast."""
        return self.kind == "stain"

    def __str__(self) -> str:
        defect = f"a {self.kind} {self._length(self.size_px)} wide"
        strength = self.strongest if self.strength is None else self.strength
        extent = f"{strength:.0%} darker" if self.is_stain else f"{self._length(strength)} deep"
        if self.strength is None:
            return f"{defect} is not found in 9 of 10 places, even if {extent}"
        return f"{defect} must be {extent} to be found in 9 of 10 places"

    def fields(self) -> dict[str, Any]:
        """Return the fields of JSON; depth or contrast are null if no strength is found."""
        strength_key = "contrast" if self.is_stain else "depth_px"
        fields = {"kind": self.kind, "size_px": self.size_px, strength_key: self.strength}
        if self.mm_per_px is not None:
            fields["size_mm"] = self.size_px * self.mm_per_px
            if not self.is_stain:
                strength = self.strength
                fields["depth_mm"] = None if strength is None else strength * self.mm_per_px
        return fields | {"text": str(self)}

    def _length(self, length_px: float) -> str:
        if self.mm_per_px is None:
            return f"{length_px:.2g} px"
        return f"{length_px:.2g} px ({length_px * self.mm_per_px:.2g} mm)"


class TaughtSet(Record):
    """A taught captured set: its file in the folder ``sets``, the hash of its pixels."""

    file: Name
    pixels_sha256: Sha256
    # Match with a library of all other sets; None for an unknown texture.
    found: Label | None = None
    nearest: Label | None = None
    distance: float | None = None


class TaughtTexture(Record):
    """Measurements on the taught parts of one texture."""

    sets: tuple[TaughtSet, ...] = Field(min_length=1)  # in the order they were given
    # Mean of each light over all parts, as a share of full scale.
    light_signals: tuple[Annotated[float, Field(gt=0.0, le=1.0)], ...]
    # Least level of an LED, as a share of the brightest, that is known by brightness alone.
    least_led_level: Annotated[float, Field(gt=0.0, le=1.0)]
    # Least and largest error of the tilts of the lights, see `tilt_error_deg`.
    tilt_errors_deg: tuple[float, float]
    defects_file: Name | None = None  # None, like the next three, for a texture that does not pass
    defects_sha256: Sha256 | None = None
    pieces_file: Name | None = None
    pieces_sha256: Sha256 | None = None
    # By the defect map at the taught limits; empty for a texture that does not pass.
    least_found: tuple[DetectionLimit, ...] = ()

    def tilt_faults(self, error_deg: float) -> Iterator[str]:
        """Yield that a part's lights have another error of their tilts than the taught parts'."""
        least_deg, largest_deg = self.tilt_errors_deg
        if not least_deg - _TILT_MARGIN_DEG <= error_deg <= largest_deg + _TILT_MARGIN_DEG:
            yield (
                f"the tilts of the lights are wrong by {error_deg:.1f} degrees, for taught parts "
                f"by {least_deg:.1f} to {largest_deg:.1f}; rotate the camera back, or teach again"
            )


class Taught(Record):
    """The measurements of teaching on all parts of a recipe."""

    format: Literal["ps4rig-taught"] = "ps4rig-taught"
    version: Literal[4] = 4
    utc: str = Field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    software_version: str = Field(default_factory=lambda: version("ps4rig"))
    setting: Setting  # of the rig; a set with another setting cannot be judged
    region: Region | None = None  # of the recipe, within which everything was measured
    has_calibration: bool
    library_sha256: Sha256
    textures: Mapping[Label, TaughtTexture] = Field(min_length=1)

    @property
    def least_found(self) -> dict[str, tuple[DetectionLimit, ...]]:
        """Detection limits of defects, for each texture that passes."""
        return {
            name: texture.least_found
            for name, texture in self.textures.items()
            if texture.least_found
        }

    @property
    def least_found_fields(self) -> list[dict[str, Any]]:
        """The entries of `least_found` as fields of JSON, each with its texture."""
        return [
            {"texture": name} | defect.fields()
            for name, defects in self.least_found.items()
            for defect in defects
        ]

    @property
    def sha256(self) -> str:
        """Hash of all fields; `Recipe.taught` holds it."""
        return fields_sha256(self.model_dump(mode="json"))


def read_taught(path: Path, remedy: str = "run ps4rig station teach") -> Taught:
    """Read the measurements of teaching."""
    try:
        return Taught.read(path, _MAX_BYTES, remedy)
    except InputError as error:
        raise RecipeError(str(error)) from error


def taught_for(recipe: Recipe, files: RecipeFolder) -> Taught:
    """Read the measurements of teaching for a recipe, and check that they cover the recipe."""
    if recipe.taught is None:
        raise RecipeError(f"{files.file}: was never taught; run ps4rig station teach")
    path = files.version(recipe.version).taught
    taught = read_taught(path)
    check_unchanged(recipe, path, taught.sha256, recipe.taught)
    if taught.region != recipe.region:
        raise RecipeError(
            f"{files.file}: region is {recipe.region or 'the whole image'}, taught was "
            f"{taught.region or 'the whole image'}; run ps4rig station teach"
        )
    missing = next((name for name in recipe.passes if name not in taught.textures), None)
    if missing is not None or not recipe.passes:
        problem = "is empty" if missing is None else f"names {missing!r}, which was not taught"
        raise RecipeError(
            f"{files.file}: pass {problem}; taught are {', '.join(map(repr, taught.textures))}; "
            "correct pass, or run ps4rig station teach"
        )
    for name in recipe.passes:
        _model_files(recipe, taught, name)
    return taught


@dataclass(frozen=True, eq=False)
class TextureModels:
    """The models of one texture that passes."""

    defects: DefectModel
    pieces: PieceModel


def models_of(files: TaughtFiles, recipe: Recipe, taught: Taught, texture: str) -> TextureModels:
    """Load the models of a texture that passes."""
    (defects_file, defects_sha256), (pieces_file, pieces_sha256) = _model_files(
        recipe, taught, texture
    )
    defects = DefectModel.load(files.folder / defects_file)
    check_unchanged(recipe, files.folder / defects_file, defects.sha256, defects_sha256)
    pieces = PieceModel.load(files.folder / pieces_file)
    check_unchanged(recipe, files.folder / pieces_file, pieces.sha256, pieces_sha256)
    return TextureModels(defects, pieces)


def check_unchanged(recipe: Recipe, path: Path, sha256: str, taught: str) -> None:
    """Check that a file has the hash that it had when the recipe was taught."""
    if sha256 != taught:
        raise RecipeError(
            f"{path}: was changed since recipe {recipe.name} was taught; run ps4rig station teach"
        )


def _model_files(
    recipe: Recipe, taught: Taught, texture: str
) -> tuple[tuple[str, str], tuple[str, str]]:
    """File and hash of the defect model of a texture, and of its piece model."""
    measured = taught.textures[texture]
    if (
        measured.defects_file is None
        or measured.defects_sha256 is None
        or measured.pieces_file is None
        or measured.pieces_sha256 is None
    ):
        raise RecipeError(
            f"recipe {recipe.name}: pass names {texture!r}, which was taught as a bad texture; run "
            "ps4rig station teach"
        )
    return (measured.defects_file, measured.defects_sha256), (
        measured.pieces_file,
        measured.pieces_sha256,
    )
