"""``ps4rig session report``."""

from pathlib import Path
from typing import Annotated

import typer

from capture.base.console import ItemProgress, out, print_json, progress, reported
from capture.commands import options
from classify.base.errors import InputError


@reported
def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the session.")],
    json: options.Json = False,
) -> None:
    """Write DIR/report.html: specimens, levels, orientations, and how the textures separate.

    A damaged set is named, also in DIR/sets.csv, and the others are reported.
    """
    from capture.session.folder import REPORT, read_session, session_folder
    from capture.session.report_analysis import analyse
    from capture.session.report_page import report_page
    from classify.base.durable_file import durable_file

    session = read_session(folder)
    path = folder / REPORT
    share = ItemProgress()
    (found,) = progress((analyse(session, share) for _ in range(1)), 1, "report", share)
    with durable_file(path) as temporary:
        temporary.write_text(report_page(session, found), encoding="utf-8")
    try:
        with session_folder(folder) as opened:
            opened.write_table(found.damaged)
    except InputError as error:
        if not isinstance(error.__cause__, BlockingIOError):
            raise  # a session in use keeps its table itself
    if json:
        damaged = [{"set": file, "error": error} for file, error in found.damaged.items()]
        remarks = [{"set": file, "remark": said} for file, said in found.remarks]
        counts = {"report": str(path), "sets": len(found.entries)}
        print_json({**counts, "damaged": damaged, "remarks": remarks})
        return
    for file, said in found.damaged.items():
        out.print(f"{file}: cannot be read: {said}")
    for file, said in found.remarks:
        out.print(f"{file}: {said}")
    out.print(f"{path}: {len(found.entries)} sets")
