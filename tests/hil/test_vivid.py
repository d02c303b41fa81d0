"""The V4L2 layer on the kernel's test camera, vivid."""

import pytest

from .checks import GUEST, Outcomes, assert_passed, names_in, run_checks

pytestmark = pytest.mark.kernel

CHECKS = GUEST / "vivid_checks.py"
# One device to stream from, one to disconnect, one to lose when the driver is unbound.
VIVID = "n_devs=3 node_types=0x1,0x1,0x1"


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> Outcomes:
    return run_checks(CHECKS, tmp_path_factory.mktemp("vivid"), modules={"vivid": VIVID})


@pytest.mark.parametrize("name", names_in(CHECKS))
def test_on_vivid(outcomes: Outcomes, name: str) -> None:
    assert_passed(outcomes, name)
