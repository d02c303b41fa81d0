"""The reference is that of the code, and every status of an error is in it."""

import re
from pathlib import Path

import pytest
from pydantic import BaseModel

from .__main__ import outdated
from .files import EXIT_STATUSES
from .keys import keys_of
from .promises import unkept

ROOT = Path(__file__).parents[2]


def test_the_pages_are_those_of_the_code() -> None:
    assert outdated() == [], "write them again: python -m tests.reference"


def test_each_promise_is_in_its_readme_and_has_its_tests() -> None:
    assert unkept() == []


def test_every_exit_status_has_its_meaning() -> None:
    sources = [
        path for room in ("capture", "rig", "classify") for path in (ROOT / room).rglob("*.py")
    ]
    statuses = re.compile(r"^    exit_status = (\d+)$", re.MULTILINE)
    found = {int(each) for path in sources for each in statuses.findall(path.read_text("utf-8"))}
    assert found
    assert found <= EXIT_STATUSES.keys()


def test_a_key_without_a_description_is_refused() -> None:
    class Undescribed(BaseModel):
        period_s: float = 1.0

    with pytest.raises(ValueError, match=r"Undescribed\.period_s"):
        keys_of(Undescribed)
