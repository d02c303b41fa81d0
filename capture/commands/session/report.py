"""``ps4rig session report``."""

from pathlib import Path
from typing import Annotated

import typer

from capture.commands import options
from capture.console import ItemProgress, out, print_json, progress, reported


@reported
def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the session.")],
    json: options.Json = False,
) -> None:
    """Write DIR/report.html: specimens, levels, orientations, and how the textures separate."""
    from capture.session.folder import REPORT, read_session
    from capture.session.report.analysis import analyse
    from capture.session.report.page import report_page
    from classify.durable_file import durable_file

    session = read_session(folder)
    path = folder / REPORT
    share = ItemProgress()
    (found,) = progress((analyse(session, share) for _ in range(1)), 1, "report", share)
    with durable_file(path) as temporary:
        temporary.write_text(report_page(session, found), encoding="utf-8")
    if json:
        remarks = [{"set": file, "remark": said} for file, said in found.remarks]
        print_json({"report": str(path), "sets": len(found.entries), "remarks": remarks})
        return
    for file, said in found.remarks:
        out.print(f"{file}: {said}", soft_wrap=True)
    out.print(f"{path}: {len(found.entries)} sets", soft_wrap=True)
