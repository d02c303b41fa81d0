"""Tests of ``ps4rig station bench`` in its quick form."""

import json
from collections.abc import Callable
from typing import Any

import pytest


@pytest.mark.slow
def test_the_bench_judges_every_part_and_says_how_fast(ps4rig: Callable[..., Any]) -> None:
    options = ("--parts", 12, "--size", 256, "--classes", 4)
    found = json.loads(ps4rig("station", "bench", *options, "--json").stdout)
    assert found["parts"] == 12
    assert sum(found["verdicts"].values()) == 12
    assert "ERROR" not in found["verdicts"]
    assert 0.0 < found["p50_ms"] <= found["p99_ms"]
    steps = {"checks", "solve", "match", "defects", "inspect", "save", "record"}
    assert set(found["steps_ms"]) == set(found["steps_p99_ms"]) == steps
    assert all(0.0 <= ms <= found["steps_p99_ms"][name] for name, ms in found["steps_ms"].items())
