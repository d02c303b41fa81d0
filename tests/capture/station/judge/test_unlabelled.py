"""Teaching of sets without a label, and the way back: another texture, or none."""

from dataclasses import replace
from pathlib import Path

import pytest

from capture.station.domain.errors import RecipeError
from capture.station.domain.recipe_file import RecipeFolder, read_recipe
from capture.station.judge.teaching.teaching import teach
from tests.capture.station.teaching_sets import patch


@pytest.fixture(scope="module")
def unlabelled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three sets of rock and three of malv, the least different pair, without labels."""
    folder = tmp_path_factory.mktemp("unlabelled")
    for surface in ("rock", "malv"):
        for number in range(3):
            captured = patch(surface, number)
            metadata = captured.metadata.model_copy(update={"label": None})
            replace(captured, metadata=metadata).save(folder / f"{surface}-{number}.ome.tif")
    return folder


@pytest.fixture
def new(tmp_path: Path) -> RecipeFolder:
    return RecipeFolder(tmp_path / "new")


def named(folder: Path, surface: str) -> list[Path]:
    return sorted(folder.glob(f"{surface}-*"))


@pytest.mark.slow
def test_sets_without_a_label_that_look_alike_are_taught_with_a_remark(
    unlabelled: Path, new: RecipeFolder
) -> None:
    teaching = teach(new, named(unlabelled, "rock"))
    assert teaching.recipe.passes == ("new",)
    assert teaching.remarks[0].startswith("3 sets without a label")


def test_sets_without_a_label_of_two_materials_are_refused(
    unlabelled: Path, new: RecipeFolder
) -> None:
    both = [*named(unlabelled, "rock"), *named(unlabelled, "malv")]
    with pytest.raises(
        RecipeError, match="6 sets have no label, and look like 2 textures: 3 like"
    ) as refused:
        teach(new, both)
    assert f"{both[0]} (kept as " in str(refused.value)
    assert not new.file.exists()


@pytest.mark.slow
def test_a_taught_part_gets_another_texture_or_is_taken_out(
    unlabelled: Path, new: RecipeFolder
) -> None:
    rock, malv = named(unlabelled, "rock"), named(unlabelled, "malv")
    teach(new, [*rock, *malv], good_texture="both")
    teach(new, malv, good_texture="malv", is_relabelling=True)
    teaching = teach(new, rock, good_texture="rock", is_relabelling=True)
    assert teaching.recipe.passes == ("malv", "rock")
    assert set(teaching.recipe.limits_of) == {"malv", "rock"}
    names = [taught.file for taught in teaching.taught.textures["malv"].sets]
    assert teach(new, [], removed=names).recipe.passes == ("rock",)
    assert read_recipe(new.file).version == 4


def test_only_a_taught_part_is_taken_out(files: RecipeFolder) -> None:
    with pytest.raises(RecipeError, match="no set of this name was taught"):
        teach(files, [], removed=["nothing.ome.tif"])
