"""Measurement of the photographs in a folder, and its files."""

from pathlib import Path

from capture.base.console import complain, progress
from capture.chapter.output import PageInfo, write_page
from classify.base.durable_file import make_folder
from classify.base.errors import InputError

from .exhibits import photograph_exhibits
from .photograph_set import PhotographSet, load_photographs, photograph_folders
from .recognition import recognitions
from .scores import scores_of


def reproduce_photographs(folder: Path, output: Path) -> Path:
    """Solve and match the photographs in a folder of folders, and write all files.

    Returns the page. A folder that cannot be read is left out with a warning, unless all are.
    """
    sets: list[PhotographSet] = []
    warnings: list[str] = []
    for each in photograph_folders(folder):
        try:
            sets.append(load_photographs(each))
            warnings += sets[-1].warnings
        except InputError as error:
            warnings.append(f"{each.name} is left out: {error}")
    if not sets:
        raise InputError("; ".join(warnings))
    for warning in warnings:
        complain(f"warning: {warning}")
    make_folder(output)
    scores = [score for each in progress(sets, len(sets), "solve") for score in scores_of(each)]
    facts = {
        "photographs": ", ".join(f"{each.name} ({len(each.directions)} lights)" for each in sets),
        "picks of four lights": str(len({(score.name, score.pick) for score in scores})),
    } | ({"left out": "; ".join(warnings)} if warnings else {})
    exhibits = list(photograph_exhibits(sets, scores, recognitions(sets)))
    info = PageInfo("photographs", Path(__file__).with_name("page.html"), simulated=False)
    return write_page(exhibits, facts, info, output)
