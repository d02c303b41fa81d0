"""Sets of a session that look like another specimen, or unlike the first set of their own."""

import math
from pathlib import Path

import numpy as np
import pytest

from capture.session.events import without_questions
from capture.session.folder import make_session, session_folder
from capture.session.journal import Description, SetEntry
from capture.session.report_analysis import Separation, analyse, outliers
from capture.session.runner import run_session
from classify.library.dissimilarity import dendrogram
from rig import RigConfig
from rig.scene.material_folder import bundled_materials

OTHER = 6.0


def separation(
    own: dict[str, list[float]], labels: dict[str, str] | None = None, other: float = OTHER
) -> Separation:
    """Return specimens with limit 2, the distances of their sets, and `other` to all others."""
    names = list(own)
    entries, rows = [], []
    for index, (name, distances) in enumerate(own.items()):
        for repeat, distance in enumerate([math.nan, *distances], start=1):
            about = Description(
                label=(labels or {}).get(name, name), specimen=name, operator=None, note=None,
                orientation_deg=0.0,
            )  # fmt: skip
            file = f"{name}-{repeat}"
            entries.append(SetEntry(specimen=name, orientation_deg=0.0, repeat=repeat,
                                    file=file, description=about))  # fmt: skip
            rows.append([distance if k == index else other for k in range(len(names))])
    between = other * (1.0 - np.eye(len(names)))
    limits = np.full(len(names), 2.0)
    tree, places = dendrogram(between), np.zeros((len(rows), 2))
    return Separation(names, entries, np.array(rows), limits, between, tree, places)


@pytest.mark.parametrize(
    ("own", "found"),
    [
        # One texture scatters more than the other.
        ({"a": [0.2] * 9, "b": [0.4, 0.97, 0.9, 0.3, 0.7]}, []),
        # Most sets repeat a placement exactly.
        ({"a": [0.01] * 9 + [0.4], "b": [0.01] * 9}, []),
        # All pieces are of one regular material: its own quarters are nearly alike.
        ({"a": [4.0, 5.5, 5.0], "b": [3.0, 5.0, 5.9]}, []),
        ({"a": [0.2] * 9 + [3.0], "b": [0.2] * 9}, ["a-11"]),
    ],
)
def test_a_set_stands_out_beyond_the_limit_and_the_other_sets(
    own: dict[str, list[float]], found: list[str]
) -> None:
    assert [file for file, _ in outliers(separation(own))] == found


def test_pieces_of_one_class_may_look_like_each_other() -> None:
    own = {"a": [0.3, 0.3], "b": [0.3, 0.3]}
    assert not [*outliers(separation(own, {"a": "felt", "b": "felt"}, other=0.2))]
    files = [file for file, _ in outliers(separation(own, other=0.2))]
    assert files == ["a-2", "a-3", "b-2", "b-3"]


@pytest.mark.slow
@pytest.mark.parametrize("material", [*bundled_materials()])
def test_ten_good_pieces_of_one_material_do_not_stand_out(
    material: str, tmp_path: Path, config: RigConfig
) -> None:
    pieces = ", ".join(
        f'{{id = "{number}", label = "it", surface = "{material}"}}' for number in range(10)
    )
    plan = tmp_path / "ten.toml"
    plan.write_text(f'name = "s"\norientations_deg = [0, 33, 71]\nspecimen = [{pieces}]\n')
    with session_folder(make_session(plan)) as session:
        run_session(session, config, without_questions, lambda _: None)
        assert analyse(session).remarks == []
