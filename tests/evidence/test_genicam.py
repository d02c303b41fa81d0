"""The short form of the study of GenICam's faults."""

import pytest

from tests.evidence.genicam import main

pytestmark = pytest.mark.genicam


def test_no_set_with_a_fault_is_accepted_wrongly() -> None:
    assert main(["--sets", "30"]) == 0
