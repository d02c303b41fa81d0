"""Repeat a selection of tests, and print which of them failed how often.

    python -m tests.repeat 20 -m "slow or browser" tests/capture/station

What follows the number goes to pytest, which runs in a new process each time. The status is 0 if
every test passed every time.
"""

import re
import subprocess
import sys
from collections import Counter

# A round that takes longer hangs; the longest suite takes a quarter of an hour on two cores.
_LONGEST_S = 2 * 3600.0
_ENDED = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)
# pytest's statuses of a run in which all tests passed, or some did not.
_PASSED, _FAILED = 0, 1


def main(times: int, arguments: list[str]) -> int:
    """Print the figures; return the exit status."""
    failures: Counter[str] = Counter()
    command = [sys.executable, "-m", "pytest", "--tb=short", "-rfE", *arguments]
    for number in range(1, times + 1):
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST_S)
        except subprocess.TimeoutExpired as hung:
            print(f"{number:3}: hangs", (hung.stdout or b"").decode(errors="replace"), sep="\n")
            return _FAILED
        *_, summary = "no output", *done.stdout.split("\n")[:-1]
        print(f"{number:3}: {summary}", flush=True)
        if done.returncode != _PASSED:
            print(done.stdout, done.stderr, sep="\n", flush=True)
        if done.returncode not in (_PASSED, _FAILED):
            return done.returncode
        failures.update(_ENDED.findall(done.stdout) or ["a test"] * done.returncode)
    for test, count in failures.most_common():
        print(f"failed {count} of {times} times: {test}")
    return int(bool(failures))


if __name__ == "__main__":
    if len(sys.argv) < 2 or not sys.argv[1].isdecimal() or int(sys.argv[1]) < 1:
        sys.exit(__doc__)
    sys.exit(main(int(sys.argv[1]), sys.argv[2:]))
