"""The ``.ps4lib`` file: what is written comes back, what is damaged is named."""

import io
import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from classify import InputError, LibraryError, TextureLibrary
from classify.library_file import VERSION


@pytest.fixture(scope="module")
def library(texture) -> TextureLibrary:
    return TextureLibrary.train(
        [("grün", texture("grain", seed=1), 12.5), ("fine", texture("fine", seed=1))]
    )


@pytest.fixture
def saved(library, tmp_path: Path) -> Path:
    path = tmp_path / "textures.ps4lib"
    library.save(path)
    return path


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write_members(path: Path, content: dict[str, bytes], compression: int = zipfile.ZIP_STORED):
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in content.items():
            archive.writestr(name, data)


def npy(array: np.ndarray, **options: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, **options)
    return stream.getvalue()


def edited(path: Path, edit: Callable[[dict[str, Any]], None]) -> Path:
    """The same library with its header changed by `edit`."""
    content = members(path)
    header = json.loads(content["library.json"])
    edit(header)
    content["library.json"] = json.dumps(header).encode()
    write_members(path, content)
    return path


def test_a_saved_library_comes_back_bit_for_bit(library, saved: Path, texture) -> None:
    loaded = TextureLibrary.load(saved)
    assert loaded.segment_px == library.segment_px
    assert loaded.labels == ("grün", "fine")
    for ours, theirs in zip(library.references, loaded.references, strict=True):
        assert ours.label == theirs.label
        assert ours.orientation_deg == theirs.orientation_deg
        np.testing.assert_array_equal(ours.signature, theirs.signature, strict=True)
    surface = texture("grain", 60.0, seed=3)
    assert loaded.classify(surface) == library.classify(surface)


def test_the_file_is_plain_json_and_numpy(saved: Path, library) -> None:
    content = members(saved)
    assert set(content) == {"library.json", "signatures.npy"}
    header = json.loads(content["library.json"])
    assert header["format"] == "ps4lib"
    assert header["version"] == VERSION == 1
    array = np.load(io.BytesIO(content["signatures.npy"]), allow_pickle=False)
    np.testing.assert_array_equal(array[1], library.references[1].signature)


def test_a_compressed_copy_is_read_as_well(saved: Path, library) -> None:
    write_members(saved, members(saved), zipfile.ZIP_DEFLATED)
    assert TextureLibrary.load(saved).labels == library.labels


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_any_other_packing_is_refused(saved: Path, compression: int) -> None:
    write_members(saved, members(saved), compression)
    with pytest.raises(LibraryError, match="packed in an unknown way"):
        TextureLibrary.load(saved)


def test_saving_again_replaces_the_file(saved: Path, library) -> None:
    TextureLibrary(library.references[:1], library.segment_px).save(saved)
    assert TextureLibrary.load(str(saved)).labels == ("grün",)
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]


@pytest.mark.parametrize(
    ("edit", "cause"),
    [
        (lambda h: h.update(version=VERSION + 1), "version 2, this program reads up to 1"),
        (lambda h: h.update(version=10**30), "this program reads up to 1"),
        (lambda h: h.update(version="2"), "header field version"),
        (lambda h: h.update(version=2.0), "header field version"),
        (lambda h: h.update(version=0), "header field version"),
        (lambda h: h.update(version=None), "header field version"),
        (lambda h: h.pop("version"), "version"),
        (lambda h: h.update(format="zip"), "header field format"),
        (lambda h: h.update(more=1), "header field more"),
        (lambda h: h.update(segment_px=31), "header field segment_px"),
        (lambda h: h.update(segment_px=10**9), "header field segment_px"),
        (lambda h: h.update(references=[]), "header field references"),
        (lambda h: h["references"].append(h["references"][0]), r"says \(3, 2, 28, 90\)"),
        (lambda h: h["references"].pop(), "claims"),
        (lambda h: h["references"][0].update(label=""), r"header field references\.0\.label"),
        (lambda h: h["references"][1].update(orientation_deg=float("nan")), "orientation_deg"),
    ],
)
def test_a_header_that_does_not_hold_is_named(
    saved: Path, edit: Callable[[dict[str, Any]], None], cause: str
) -> None:
    with pytest.raises(LibraryError, match=cause) as caught:
        TextureLibrary.load(edited(saved, edit))
    assert str(saved) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "header",
    [b"", b"{", b"\xff\xfe", b"[]", b"3", b"null", b'"text"', b"[" * 200_000, b'{"version": [1]}'],
)
def test_a_header_that_is_not_json_of_the_right_kind_is_refused(saved: Path, header: bytes) -> None:
    write_members(saved, members(saved) | {"library.json": header})
    with pytest.raises(LibraryError, match=str(saved)):
        TextureLibrary.load(saved)


SHAPE = (2, 2, 28, 90)


def claimed(shape: str, descr: str = "'<f4'") -> bytes:
    """An npy file of 16 bytes whose header claims any shape."""
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(16)


@pytest.mark.parametrize(
    ("array", "cause"),
    [
        (npy(np.ones((2, 2, 28, 89), np.float32)), "signatures are"),
        (npy(np.ones((3, 2, 28, 90), np.float32)), "claims"),
        (npy(np.ones((2, 2, 90, 28), np.float32).T), "signatures are"),
        (npy(np.ones(4, np.float32)), "signatures are"),
        (npy(np.ones(SHAPE)), "claims"),
        (npy(np.ones(SHAPE, np.int32)), "int32"),
        (npy(np.ones(SHAPE, ">f4")), ">f4"),
        (npy(np.full(SHAPE, np.nan, np.float32)), "NaN"),
        (npy(np.full(SHAPE, np.inf, np.float32)), "NaN"),
        (npy(np.ones(SHAPE, np.float32))[:-1], "not a readable library"),
        (npy(np.ones(SHAPE, np.float32)) + b"x" * 100_000, "claims"),
        (npy(np.full(SHAPE[1:], None), allow_pickle=True), "object"),
        (claimed("(10**9,)"), "not a readable library"),
        (claimed("(1000000000000,)"), "signatures are"),
        (claimed("(4611686018427387904, 4)"), "signatures are"),
        (claimed("(-1,)"), "signatures are"),
        (claimed("(2, 2, 28, 90)"), "not a readable library"),
        (claimed("(1,", "'<f4'"), "not a readable library"),
        (claimed("(), b'': 1, 'x': 2"), "not a readable library"),
        (claimed("-" * 8000 + "1"), "not a readable library"),
        (claimed("(2, 02)"), "not a readable library"),
        (claimed("(2, 2, 0090L, 90)"), "not a readable library"),
        (claimed("(\\x00,)"), "not a readable library"),
        (claimed("()" + 20_000 * " "), "not a readable library"),
        (claimed("()", "'O'"), "signatures are"),
        (claimed("()", "[('a', '<f4')]"), "signatures are"),
        (b"", "not a readable library"),
        (b"PK\x03\x04 not numpy", "not a readable library"),
        (b"cos\nsystem\n(S'true'\ntR.", "not a readable library"),
    ],
)
def test_an_array_that_does_not_hold_is_refused(saved: Path, array: bytes, cause: str) -> None:
    write_members(saved, members(saved) | {"signatures.npy": array})
    with pytest.raises(LibraryError, match=cause) as caught:
        TextureLibrary.load(saved)
    assert str(saved) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_npz_in_place_of_the_array_is_refused(saved: Path) -> None:
    stream = io.BytesIO()
    np.savez(stream, signatures=np.ones(SHAPE, np.float32))
    write_members(saved, members(saved) | {"signatures.npy": stream.getvalue()})
    with pytest.raises(LibraryError, match="not a readable library"):
        TextureLibrary.load(saved)


class Explosive:
    """Unpickling this would make a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


def test_nothing_in_a_library_is_unpickled(saved: Path) -> None:
    trap = saved.parent / "trap"
    array = np.array([Explosive(trap)], dtype=object)
    write_members(saved, members(saved) | {"signatures.npy": npy(array, allow_pickle=True)})
    with pytest.raises(LibraryError):
        TextureLibrary.load(saved)
    assert not trap.exists()


@pytest.mark.parametrize("name", ["library.json", "signatures.npy"])
def test_a_zip_without_one_of_its_parts_is_no_library(saved: Path, name: str) -> None:
    content = members(saved)
    del content[name]
    write_members(saved, content)
    with pytest.raises(LibraryError, match=f"holds no {name}"):
        TextureLibrary.load(saved)


def test_a_part_that_unpacks_to_far_too_much_is_refused(saved: Path) -> None:
    bomb = members(saved) | {"library.json": b" " * (65 * 2**20)}
    write_members(saved, bomb, zipfile.ZIP_DEFLATED)
    assert saved.stat().st_size < 2**20
    with pytest.raises(LibraryError, match=r"library\.json claims"):
        TextureLibrary.load(saved)


def test_a_missing_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(LibraryError, match="no such library; make one with ps4rig train"):
        TextureLibrary.load(tmp_path / "none.ps4lib")


@pytest.mark.parametrize("content", [b"", b"PK", b"no zip at all" * 100])
def test_a_file_that_is_no_zip_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.ps4lib"
    path.write_bytes(content)
    with pytest.raises(LibraryError, match="not a readable library"):
        TextureLibrary.load(path)


def test_a_folder_is_no_library(tmp_path: Path) -> None:
    with pytest.raises(LibraryError, match="not a readable library"):
        TextureLibrary.load(tmp_path)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_library_cut_off_anywhere_is_refused(saved: Path, share: float) -> None:
    whole = saved.read_bytes()
    part = saved.with_suffix(".part")
    part.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(LibraryError):
        TextureLibrary.load(part)


@settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data(), compression=st.sampled_from([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED]))
def test_a_flipped_byte_is_refused_or_harmless(
    saved: Path, library, data: st.DataObject, compression: int
) -> None:
    """Whatever the byte: a `LibraryError` or the same library, nothing else."""
    copy = saved.with_suffix(".copy")
    write_members(copy, members(saved), compression)
    content = bytearray(copy.read_bytes())
    # Most of the file is numbers; the places where names, sizes and methods stand get their share.
    near_edges = st.integers(0, 600) | st.integers(len(content) - 300, len(content) - 1)
    at = data.draw(near_edges | st.integers(0, len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    copy.write_bytes(content)
    try:
        loaded = TextureLibrary.load(copy)
    except LibraryError:
        return
    for ours, theirs in zip(library.references, loaded.references, strict=True):
        assert ours.label == theirs.label
        np.testing.assert_array_equal(ours.signature, theirs.signature)


def test_a_folder_that_does_not_exist_is_named(library, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written: there is no folder"):
        library.save(tmp_path / "none" / "x.ps4lib")


FILL_DISK = """
import resource, signal, sys
from classify import InputError, TextureLibrary
library = TextureLibrary.load(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192))
try:
    library.save(sys.argv[1])
except InputError as error:
    print(error)
else:
    sys.exit("saved")
"""


def test_a_full_disk_is_one_line_and_leaves_the_old_library(saved: Path) -> None:
    """A limit on the size of files stands for the disk."""
    before = saved.read_bytes()
    assert len(before) > 8192
    run = subprocess.run(
        [sys.executable, "-c", FILL_DISK, str(saved)], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == f"{saved}: cannot be written: File too large"
    assert run.stderr == ""
    assert saved.read_bytes() == before
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]
