"""The short form of each study that prints figures beside their limits."""

from collections.abc import Callable, Sequence

import pytest

from . import (
    defect_constants,
    drift_rates,
    joint_constants,
    light_order_rates,
    orientation_flags,
    photograph_rates,
    session_faults,
    session_kills,
    sphere_rates,
    true_normals,
    uncertainty,
)
from .station import history

STUDIES = (
    defect_constants, drift_rates, history, joint_constants, light_order_rates, orientation_flags,
    photograph_rates, session_faults, session_kills, sphere_rates, true_normals, uncertainty,
)  # fmt: skip
Main = Callable[[Sequence[str]], int]


@pytest.mark.slow
@pytest.mark.parametrize(
    "main", [study.main for study in STUDIES], ids=[study.__name__ for study in STUDIES]
)
def test_every_figure_is_within_its_limit(main: Main) -> None:
    assert main(["--quick"]) == 0


@pytest.mark.parametrize("study", [defect_constants, joint_constants])
def test_the_constants_of_a_study_are_there(study: object) -> None:
    for module, names in study.CONSTANTS.items():
        assert set(names) <= vars(module).keys()
