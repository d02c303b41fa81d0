"""Which files a command may write."""

import csv
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from capture.base.outputs import check_output, csv_line
from classify import InputError


@pytest.fixture
def existing(tmp_path: Path) -> Path:
    path = tmp_path / "a.ome.tif"
    path.touch()
    return path


def refuse(path: Path, reason: str, *, inputs: tuple[Path, ...] = (), force: bool = False) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(str(path))}: .*{reason}"):
        check_output(path, suffix=".ome.tif", inputs=inputs, force=force)


def test_a_new_file_may_be_written(tmp_path: Path, existing: Path) -> None:
    check_output(tmp_path / "new.ome.tif", suffix=".ome.tif", inputs=[existing, tmp_path / "none"])
    assert not (tmp_path / "new.ome.tif").exists()


def test_an_existing_file_is_replaced_with_force_only(existing: Path) -> None:
    refuse(existing, "exists already; .* --force")
    check_output(existing, suffix=".ome.tif", force=True)


@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_an_output_never_replaces_an_input(existing: Path, link: Callable[..., None]) -> None:
    name = existing.with_name("link.ome.tif")
    link(existing, name)
    for output in (existing, name):
        refuse(output, "is an input", inputs=(existing,), force=True)


def test_other_names_and_places_are_refused(tmp_path: Path) -> None:
    refuse(tmp_path / "a.tif", r"must end in \.ome\.tif", force=True)
    refuse(tmp_path / "none" / "a.ome.tif", "there is no folder", force=True)
    (tmp_path / "folder.ome.tif").mkdir()
    refuse(tmp_path / "folder.ome.tif", "not a regular file", force=True)


def test_a_link_to_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    """It may be the rig or the calibration of the command."""
    rig, link = tmp_path / "rig.toml", tmp_path / "a.ome.tif"
    rig.write_text("[lights]")
    link.symlink_to(rig)
    refuse(link, r"leads to .*rig\.toml, whose name does not end in \.ome\.tif", force=True)


def test_a_loop_of_links_is_no_folder(tmp_path: Path) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    refuse(loop / "b.ome.tif", "there is no folder", force=True)


@pytest.mark.parametrize(
    ("cell", "written"),
    [
        ("=HYPERLINK(1)", "'=HYPERLINK(1)"),
        ("@SUM(1)", "'@SUM(1)"),
        ("+cmd|' /C calc'!A0", "'+cmd|' /C calc'!A0"),
        ("-1.5", "-1.5"),
        (-1.5, "-1.5"),
        ("part-000001", "part-000001"),
    ],
)
def test_a_spreadsheet_takes_no_cell_for_a_formula(cell: object, written: str) -> None:
    [[found]] = csv.reader([csv_line([cell])])
    assert found == written
