"""Measurement of the photographs in a folder, and its files."""

from pathlib import Path

from capture.console import progress
from capture.studies.reproduction.output import About, write_page
from classify.durable_file import make_folder

from .exhibits import photograph_exhibits
from .photograph_set import load_photographs, photograph_folders
from .recognition import recognitions
from .scores import scores_of


def reproduce_photographs(folder: Path, output: Path) -> Path:
    """Solve and match the photographs in a folder of folders, and write all files.

    Returns the page.

    Raises
    ------
    InputError
        If `folder` holds no photographs, a file in it cannot be read, or `output` cannot be made.
    """
    sets = [load_photographs(each) for each in photograph_folders(folder)]
    make_folder(output)
    scores = [score for each in progress(sets, len(sets), "solve") for score in scores_of(each)]
    facts = {
        "photographs": ", ".join(f"{each.name} ({len(each.directions)} lights)" for each in sets),
        "picks of four lights": str(len({(score.name, score.pick) for score in scores})),
    }
    exhibits = list(photograph_exhibits(sets, scores, recognitions(sets)))
    about = About("photographs", Path(__file__).parents[1] / "photographs.html", simulated=False)
    return write_page(exhibits, facts, about, output)
