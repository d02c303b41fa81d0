"""Print the speed of this machine: `python -m tests.evidence.benchmark [--quick] [--json]`."""

import argparse

from .run import print_benchmark
from .settings import FULL, QUICK

parser = argparse.ArgumentParser(
    prog="python -m tests.evidence.benchmark",
    description="Measure times, most as ratios to a lower bound of the same run, and memory.",
)
parser.add_argument("--quick", action="store_true", help="fewer rounds and references; one minute")
parser.add_argument("--json", action="store_true", help="print JSON")
options = parser.parse_args()
print_benchmark(QUICK if options.quick else FULL, options.json)
