"""``ps4rig verify``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import out, print_json, progress, reported

from . import options

if TYPE_CHECKING:
    from capture.session.verification import FileFinding


@reported
def verify(
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Folders, with all folders below.")
    ],
    json: options.Json = False,
) -> None:
    """Check that sets, libraries, calibrations, sessions and stations are whole and unaltered.

    Every file is read and hashed anew, and the sets of a station are compared with its results.
    Libraries and defect models have checksums against damage only: a recipe keeps their hashes. The
    exit status is 1 if something is missing, altered, without its calibration, or of a schema
    without a hash.
    """
    from capture.session.verification import files_below, verify_file
    from capture.station.domain.config import CONFIG

    paths = [path for folder in folders for path in files_below(folder, CONFIG)]
    findings: list[FileFinding] = []
    for path in progress(paths, len(paths), "verify"):
        if path.name == CONFIG:
            from capture.station.results.verification import verify_station

            findings += verify_station(path.parent)
        else:
            findings += verify_file(path)
    wrong = [finding for finding in findings if finding.state != "good"]
    if json:
        print_json(
            {
                "files": len(paths),
                "findings": [
                    {"path": str(finding.path), "state": finding.state, "said": finding.details}
                    for finding in wrong
                ],
            }
        )
    else:
        for finding in wrong:
            out.print(f"{finding.path}: {finding.state}: {finding.details}")
        counts = Counter(finding.state for finding in findings)
        summary = ", ".join(f"{count} {state}" for state, count in sorted(counts.items()))
        out.print(f"{len(paths)} files: {summary}")
    if wrong:
        raise typer.Exit(1)
