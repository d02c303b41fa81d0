"""Print times and recall of matches in large libraries, mixed from synthetic textures.

    python -m tests.evidence.benchmark [--quick]

A library of 100,000 references takes 1.1 GB of the disk and 2.5 GB of memory while it is written;
--quick leaves it out.
"""

import argparse
import tempfile
from pathlib import Path

from capture.base.console import out
from rig import SYNTHETIC_TEXTURES

from .measurements import print_section
from .mixtures import SETS_OF_A_CLASS, Mixtures, observed_textures
from .search import Settings, search_section

_TEXTURE_PX = 512

parser = argparse.ArgumentParser(prog="python -m tests.evidence.benchmark")
parser.add_argument("--quick", action="store_true", help="fewer rounds and references")
if parser.parse_args().quick:
    settings = Settings(largest_library=None, match_rounds=1, recall_queries=100)
else:
    settings = Settings()
textures = observed_textures(SYNTHETIC_TEXTURES, _TEXTURE_PX)
references = settings.largest_library or settings.library_sizes[-1]
mixtures = Mixtures(textures, references // SETS_OF_A_CLASS)
with tempfile.TemporaryDirectory(prefix="ps4rig-bench-") as folder:
    largest = None
    if settings.largest_library is not None:
        largest = Path(folder) / "largest.ps4lib"
        mixtures.library(references).save(largest)
        out.print(f"{references:,} references: {largest.stat().st_size / 1e9:.2f} GB")
    print_section(search_section(mixtures, largest, settings))
