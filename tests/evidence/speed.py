"""Print the way from four images to a match, part by part: `python -m tests.evidence.speed`.

Each part stands beside the memory floor, numpy, and a peer that installs from PyPI (`pip install
'ps4rig[evidence]'`). With `--before CHECKOUT` another version is measured first, by the same code.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from capture.base.console import print_json
from capture.base.process_settings import configure_process
from classify import TextureLibrary
from rig import SYNTHETIC_30
from tests.evidence.benchmark.measurements import Section, as_json, print_section
from tests.evidence.benchmark.pipeline import pipeline_section
from tests.evidence.benchmark.scenes import texture_tile
from tests.evidence.benchmark.start import start_section

_TAUGHT_PX = 512
_HERE = Path(__file__).parents[2]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and print each table when it is ready, or all as JSON."""
    parser = argparse.ArgumentParser(prog="python -m tests.evidence.speed", description=__doc__)
    parser.add_argument(
        "--rounds", type=int, default=60, help="calls, of which the shortest counts"
    )
    parser.add_argument("--sets", type=int, default=1000, help="sets of a batch")
    parser.add_argument(
        "--before", type=Path, metavar="CHECKOUT", help="folder of the version before"
    )
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    configure_process()
    before = {}
    if options.before is not None:
        before = _figures_of(options.before.absolute(), options.rounds, options.sets)
    sections = _sections(options.rounds, options.sets)
    if options.json:
        print_json([*map(as_json, sections)])
        return 0
    for section in sections:
        print_section(section, before.get(section.title, {}))
    return 0


def _sections(rounds: int, sets: int) -> Iterator[Section]:
    taught = [
        (texture, texture_tile(texture, seed, _TAUGHT_PX).solve(planar=True))
        for seed, texture in enumerate(SYNTHETIC_30)
    ]
    library = TextureLibrary.train(taught)
    for size_px in (512, 1024):
        yield pipeline_section(library, size_px, rounds)
    yield start_section(library, sets)


def _figures_of(checkout: Path, rounds: int, sets: int) -> dict[str, dict[str, float]]:
    """Values by section and step of the packages of another checkout, measured by this file."""
    command = [sys.executable, "-m", "tests.evidence.speed", "--json"]
    command += [f"--rounds={rounds}", f"--sets={sets}"]
    with tempfile.TemporaryDirectory(prefix="ps4rig-before-") as name:
        for package in ("capture", "classify", "rig", "firmware_sim"):
            (Path(name) / package).symlink_to(checkout / package)
        # The packages of the working folder come first, `tests` is found here.
        result = subprocess.run(
            command, check=True, cwd=name, stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": str(_HERE)},
        )  # fmt: skip
    return {
        section["title"]: {figure["step"]: figure["value"] for figure in section["figures"]}
        for section in json.loads(result.stdout)
    }


if __name__ == "__main__":
    raise SystemExit(main())
