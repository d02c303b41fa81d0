"""Read the files that teaching made for a recipe, and check that none was changed since."""

from dataclasses import dataclass
from pathlib import Path

from capture.station.domain.errors import RecipeError
from classify import DefectModel
from classify.pieces.piece_model import PieceModel

from .recipe import Recipe
from .recipe_folder import RecipeFolder, TaughtFiles
from .taught import Taught, read_taught


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
        _models_of(recipe, taught, name)
    return taught


@dataclass(frozen=True, eq=False)
class TextureModels:
    """What teaching learned of one texture that passes."""

    defects: DefectModel
    pieces: PieceModel


def models_of(files: TaughtFiles, recipe: Recipe, taught: Taught, texture: str) -> TextureModels:
    """Load the models of a texture that passes."""
    (defects_file, defects_sha256), (pieces_file, pieces_sha256) = _models_of(
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


def _models_of(
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
