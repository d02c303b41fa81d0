"""Print the way from four images to a match, part by part: `python -m tests.evidence.speed`.

Each part stands beside the memory floor, numpy, and a peer that installs from PyPI (`pip install
'ps4rig[evidence]'`).
"""

import argparse
from collections.abc import Sequence

from capture.base.process_settings import settle_process
from classify import TextureLibrary
from rig import SYNTHETIC_30
from tests.evidence.benchmark.measurements import print_section
from tests.evidence.benchmark.pipeline import pipeline_section
from tests.evidence.benchmark.scenes import texture_tile
from tests.evidence.benchmark.start import start_section

_TAUGHT_PX = 512


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and print each table when it is ready."""
    parser = argparse.ArgumentParser(prog="python -m tests.evidence.speed", description=__doc__)
    parser.add_argument(
        "--rounds", type=int, default=60, help="calls, of which the shortest counts"
    )
    parser.add_argument("--sets", type=int, default=1000, help="sets of a batch")
    options = parser.parse_args(arguments)
    settle_process()
    taught = [
        (texture, texture_tile(texture, seed, _TAUGHT_PX).solve(planar=True))
        for seed, texture in enumerate(SYNTHETIC_30)
    ]
    library = TextureLibrary.train(taught)
    for size_px in (512, 1024):
        print_section(pipeline_section(library, size_px, options.rounds))
    print_section(start_section(library, options.sets))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
