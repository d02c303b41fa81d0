"""The ``.ps4lib`` file: written libraries are read back, damaged ones refused."""

import io
import json
import os
import tracemalloc
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from classify import InputError, LibraryError, Lighting, TextureLibrary
from classify.library import ps4lib
from classify.library.ps4lib import VERSION
from tests.archives import members, npy, write_members

ARRAYS = ("classes.npy", "orientations_deg.npy", "signatures.npy")
# Of the small libraries here only the signatures are larger.
SMALL_BYTES = 12_000
UNREADABLE = "not a readable library"


@pytest.fixture(scope="module")
def library(stationary, photographed) -> TextureLibrary:
    rows = (("grün", "sand", 12.5), ("fine", "fine sand", None), ("grün", "sand", 12.5))
    return TextureLibrary.train(
        (label, photographed(stationary(kind, seed=seed, side=64)), orientation_deg)
        for seed, (label, kind, orientation_deg) in enumerate(rows)
    )


def load_mapped(path: Path) -> TextureLibrary:
    """Open a small library like a large one."""
    return TextureLibrary.load(path, map_from_bytes=SMALL_BYTES)


def assert_equal(ours: TextureLibrary, theirs: TextureLibrary) -> None:
    assert ours.labels == theirs.labels
    fields = (
        "classifier",
        "segment_px",
        "uniformity",
        "limits",
        "simulated",
        "sources",
        "classes",
        "oriented",
    )
    for field in fields:
        assert getattr(ours, field) == getattr(theirs, field)
    assert (ours.lighting is None) == (theirs.lighting is None)
    np.testing.assert_array_equal(ours.orientations_deg, theirs.orientations_deg, strict=True)
    np.testing.assert_array_equal(ours.signatures, np.asarray(theirs.signatures), strict=True)
    assert list(ours.parameters) == list(theirs.parameters)
    for name, values in ours.parameters.items():
        np.testing.assert_array_equal(values, np.asarray(theirs.parameters[name]), strict=True)


@pytest.fixture
def saved(library, tmp_path: Path) -> Path:
    path = tmp_path / "textures.ps4lib"
    library.save(path)
    return path


def with_its_hash(content: dict[str, bytes]) -> dict[str, bytes]:
    """The members with the hash of what they hold, so that the other checks are tested."""
    with suppress(Exception):  # what cannot be read has no hash
        header = json.loads(content["library.json"])
        arrays = {
            name.removesuffix(".npy"): np.load(io.BytesIO(data))
            for name, data in content.items()
            if name.endswith(".npy")
        }
        sha256 = ps4lib._sha256(ps4lib._Header.model_validate(header), arrays)
        return content | {"library.json": json.dumps(header | {"sha256": sha256}).encode()}
    return content


def put(path: Path, **content: bytes) -> None:
    """Replace or add members, named without ``.npy``; ``header`` is the JSON header."""
    names = {name: "library.json" if name == "header" else f"{name}.npy" for name in content}
    stored = members(path) | {names[name]: data for name, data in content.items()}
    write_members(path, with_its_hash(stored))


def assert_refused(path: Path, cause: str, **options: Any) -> None:
    """Loading raises one line that names the file and matches `cause`."""
    with pytest.raises(LibraryError, match=cause) as caught:
        TextureLibrary.load(path, **options)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def edited(path: Path, edit: Callable[[dict[str, Any]], None]) -> Path:
    """The same library with its header changed by `edit`."""
    content = members(path)
    header = json.loads(content["library.json"])
    edit(header)
    content["library.json"] = json.dumps(header).encode()
    write_members(path, with_its_hash(content))
    return path


def test_a_saved_library_is_read_bit_for_bit(library, saved: Path, stationary) -> None:
    loaded = TextureLibrary.load(saved)
    assert_equal(library, loaded)
    assert loaded.labels == ("grün", "fine", "grün")
    assert loaded.lighting.within(1e-6, Lighting.ring(45.0))
    assert not isinstance(loaded.signatures, np.memmap)
    surface = stationary("sand", 60.0, seed=3)
    assert loaded.classify(surface) == library.classify(surface)


def test_lighting_sources_and_simulated_are_read_back(library, tmp_path: Path) -> None:
    path = tmp_path / "x.ps4lib"
    sources = (("one.ome.tif", "ab" * 32), ("zwei drei.ome.tif", ""))
    for lighting in (None, Lighting.ring(50.0, (0, 120, 240))):
        noted = replace(library, simulated=True, sources=sources, lighting=lighting)
        noted.save(path)
        loaded = TextureLibrary.load(path)
        assert_equal(noted, loaded)
        if lighting is not None:
            np.testing.assert_allclose(loaded.lighting.directions, lighting.directions)


def test_the_file_is_plain_json_and_numpy(saved: Path, library) -> None:
    content = members(saved)
    parameters = {f"parameters/{name}.npy" for name in library.parameters}
    assert set(content) == {"library.json", *ARRAYS, *parameters}
    header = json.loads(content["library.json"])
    assert header["format"] == "ps4lib"
    assert header["version"] == VERSION == 8
    assert header["classes"] == ["grün", "fine"]
    array = np.load(io.BytesIO(content["signatures.npy"]), allow_pickle=False)
    np.testing.assert_array_equal(array, library.signatures)
    indices = np.load(io.BytesIO(content["classes.npy"]), allow_pickle=False)
    assert indices.tolist() == [0, 1, 0]
    with zipfile.ZipFile(saved) as archive:
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_STORED}


def test_a_compressed_copy_is_read_as_well(saved: Path, library) -> None:
    write_members(saved, members(saved), zipfile.ZIP_DEFLATED)
    assert TextureLibrary.load(saved).labels == library.labels


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_any_other_packing_is_refused(saved: Path, compression: int) -> None:
    write_members(saved, members(saved), compression)
    assert_refused(saved, "compressed by an unknown method")


@pytest.mark.parametrize(
    ("edit", "cause"),
    [
        (lambda h: h.update(version=9), "version 9; .* 8; use a newer"),
        (lambda h: h.update(version=7), "version 7; .* 8; train it again"),
        (lambda h: h.pop("version"), "version"),
        (lambda h: h.update(more=1), "header field 'more'"),
        (lambda h: h.update(classes=["a\x1b[0m", "b"]), r"classes\.0.*do not print"),
        (lambda h: h.update(classifier="fortune"), "classifier 'fortune'"),
        (lambda h: h["limits"].update(fine=float("nan")), "header field limits: .*'fine'"),
        (lambda h: h["uniformity"].update(fine="odd"), "header field uniformity"),
        (lambda h: h.update(light_directions=[[0, 0, -1]]), "light 0 .*horizon"),
    ],
)
def test_a_wrong_header_field_is_named(
    saved: Path, edit: Callable[[dict[str, Any]], None], cause: str
) -> None:
    assert_refused(edited(saved, edit), cause)


@pytest.mark.parametrize("header", [b"[]", b"[" * 200_000])
def test_a_header_that_is_not_a_json_object_is_refused(saved: Path, header: bytes) -> None:
    put(saved, header=header)
    assert_refused(saved, "header|not a readable library")


def claimed(shape: str, descr: str = "'<f4'", content: bytes = bytes(16)) -> bytes:
    """An npy file of 16 bytes whose header claims any shape."""
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + content


@pytest.mark.parametrize(
    ("array", "cause"),
    [
        (npy(np.ones((2, 5), np.float32)), r"3 references, and arrays of \(3,\), \(2, 5\)"),
        (npy(np.ones((5, 3), np.float32).T), "signatures.npy is"),
        (npy(np.ones((3, 5))), "float64"),
        (npy(np.full((3, 5), np.nan, np.float32)), "NaN"),
        (npy(np.ones((3, 5), np.float32))[:-1], "in 59 bytes"),
        (npy(np.ones((3, 5), np.float32)) + b"x" * 100_000, "in 100060 bytes"),
        (npy(np.full((3, 5), None), allow_pickle=True), "object"),
        (claimed("(10**9,)"), UNREADABLE),
        (claimed("(1000000000000,)"), "in 16 bytes"),
        (claimed("(-1, -4)"), UNREADABLE),
        (claimed("-" * 8000 + "1"), UNREADABLE),
        (claimed("()", "'O'"), "signatures.npy is"),
        (b"", UNREADABLE),
    ],
)
def test_a_damaged_array_is_refused(saved: Path, array: bytes, cause: str) -> None:
    """Whether read or mapped; a match tests the numbers of a mapped array."""
    put(saved, signatures=array)
    for mapped_from in (SMALL_BYTES,) if cause == "NaN" else (SMALL_BYTES, 1):
        assert_refused(saved, cause, map_from_bytes=mapped_from)


@pytest.mark.parametrize(
    ("name", "array", "cause"),
    [
        ("classes", np.array([0, 1, 2], "<i4"), "class has no name"),
        ("classes", np.array([0, -1, 0], "<i4"), "class has no name"),
        ("classes", np.array([0, 1], "<i4"), "2 references"),
        ("classes", np.empty(0, "<i4"), "0 references"),
        ("classes", np.array([0, 1, 0], "<i8"), "int64"),
        ("orientations_deg", np.array([0, np.nan, 0]), "NaN"),
        ("orientations_deg", np.zeros(4), "3 references"),
        ("parameters/whitening", np.full((2, 2), np.nan), "NaN"),
        ("invariants", np.ones((2, 5), np.float32), "3 references"),
        ("invariants", np.full((3, 5), np.nan, np.float32), "NaN"),
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(
    saved: Path, name: str, array: np.ndarray, cause: str
) -> None:
    put(saved, **{name: npy(array)})
    assert_refused(saved, cause)


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("whitening", np.ones((2, 2))),
        ("density_floor", None),
        ("heading_variances", np.ones((1, 5))),
        ("limit", np.ones(2)),
    ],
)
def test_a_parameter_of_another_shape_is_refused(
    saved: Path, name: str, array: np.ndarray | None
) -> None:
    content = members(saved)
    del content[f"parameters/{name}.npy"]
    if array is not None:
        content[f"parameters/{name}.npy"] = npy(array)
    write_members(saved, with_its_hash(content))
    assert_refused(saved, rf"parameter {name}.*; train it again$")


@pytest.mark.parametrize(
    ("name", "cause"),
    [("signatures", "signatures have shape"), ("invariants", "invariants do not fit")],
)
def test_signatures_of_another_classifier_are_refused_by_a_match(
    saved: Path, stationary, name: str, cause: str
) -> None:
    put(saved, **{name: npy(np.ones((3, 5), np.float32))})
    loaded = TextureLibrary.load(saved)
    with pytest.raises(LibraryError, match=cause):
        loaded.classify(stationary("sand", side=64))


def test_a_library_of_thousands_of_parameters_is_refused(saved: Path) -> None:
    put(saved, **{f"parameters/{i}": npy(np.zeros(1)) for i in range(100)})
    assert_refused(saved, "parameters; the file is damaged")


@pytest.mark.parametrize("name", ["library.json", *ARRAYS])
def test_a_zip_without_one_of_the_members_is_no_library(saved: Path, name: str) -> None:
    content = members(saved)
    del content[name]
    write_members(saved, content)
    assert_refused(saved, f"holds no {name}")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("library.json", b" " * 2**23),
        ("library.json", b'{"version": 8, "classes": [' + b'"a",' * 2**20 + b'"a"]}'),
        ("signatures.npy", npy(np.zeros((3, 2**20), np.float32))),
        ("something else", bytes(2**23)),
    ],
)
def test_members_that_would_fill_the_memory_are_refused(
    saved: Path, name: str, content: bytes
) -> None:
    """Declared sizes are compared with that of the file before it is unpacked."""
    write_members(saved, members(saved) | {name: content}, zipfile.ZIP_DEFLATED)
    size = saved.stat().st_size
    assert size < 2**16
    assert_refused(saved, rf": declares \d+ bytes in a file of {size}; ")


def test_thousands_of_errors_in_a_header_take_little_memory(saved: Path) -> None:
    edited(saved, lambda header: header.update(sources=[[]] * 100_000))
    tracemalloc.start()
    try:
        assert_refused(saved, "header field")
        assert tracemalloc.get_traced_memory()[1] < 40e6
    finally:
        tracemalloc.stop()


def patched(path: Path, name: str, central: dict[int, bytes], local: dict[int, bytes]) -> None:
    """Replace bytes of the two headers of a member, at offsets from their beginnings."""
    content = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        start = archive.getinfo(name).header_offset
    where = content.rindex(name.encode()) - 46
    assert content[where : where + 4] == b"PK\x01\x02"
    for at, changes in ((where, central), (start, local)):
        for offset, data in changes.items():
            content[at + offset : at + offset + len(data)] = data
    path.write_bytes(content)


def test_an_encrypted_member_is_refused(saved: Path) -> None:
    patched(saved, "signatures.npy", {8: b"\x01\x00"}, {6: b"\x01\x00"})
    assert_refused(saved, r"not a readable library .*encrypted")


def test_a_missing_file_says_how_to_make_one(tmp_path: Path) -> None:
    assert_refused(tmp_path / "none.ps4lib", "no such library; make one with ps4rig train")


def test_folders_pipes_and_files_that_are_no_zip_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "x.ps4lib")
    for path in (tmp_path, tmp_path / "x.ps4lib"):
        assert_refused(path, "cannot be read")
    (tmp_path / "text.ps4lib").write_bytes(b"no zip at all" * 100)
    assert_refused(tmp_path / "text.ps4lib", UNREADABLE)


FIXTURE = HealthCheck.function_scoped_fixture


@settings(max_examples=60, deadline=None, suppress_health_check=[FIXTURE])
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_library_cut_off_anywhere_is_refused(saved: Path, share: float) -> None:
    whole = saved.read_bytes()
    part = saved.with_suffix(".part")
    part.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(LibraryError):
        load_mapped(part)


def flipped(saved: Path, data: st.DataObject, compression: int) -> Path:
    """A copy with one byte changed."""
    copy = saved.with_suffix(".copy")
    write_members(copy, members(saved), compression)
    content = bytearray(copy.read_bytes())
    # Most of the file is numbers; bytes of names, sizes and methods are drawn more often.
    near_edges = st.integers(0, 1200) | st.integers(len(content) - 1500, len(content) - 1)
    at = data.draw(near_edges | st.integers(0, len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    copy.write_bytes(content)
    return copy


@settings(max_examples=150, deadline=None, suppress_health_check=[FIXTURE])
@given(data=st.data(), compression=st.sampled_from([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED]))
def test_a_flipped_byte_is_refused_or_harmless(
    saved: Path, library, data: st.DataObject, compression: int
) -> None:
    """A damaged library gives a `LibraryError` or the same library."""
    try:
        loaded = TextureLibrary.load(flipped(saved, data, compression))
    except LibraryError:
        return
    assert_equal(library, loaded)


@settings(max_examples=100, deadline=None, suppress_health_check=[FIXTURE])
@given(data=st.data())
def test_a_flipped_byte_of_a_mapped_library_changes_one_number_at_most(
    saved: Path, library, data: st.DataObject
) -> None:
    """To test its checksum would take the time that mapping saves."""
    try:
        loaded = load_mapped(flipped(saved, data, zipfile.ZIP_STORED))
    except LibraryError:
        return
    assert loaded.labels == library.labels
    assert loaded.signatures.shape == library.signatures.shape
    changed = np.asarray(loaded.signatures).view(np.uint32) != library.signatures.view(np.uint32)
    assert changed.sum() <= 1
    np.testing.assert_array_equal(loaded.orientations_deg, library.orientations_deg)


def test_a_mapped_library_gives_the_same_match(library, saved: Path, stationary) -> None:
    loaded = load_mapped(saved)
    assert isinstance(loaded.signatures, np.memmap)
    assert not loaded.signatures.flags.writeable
    assert not isinstance(loaded.orientations_deg, np.memmap)
    assert_equal(library, loaded)
    surface = stationary("sand", 60.0, seed=3)
    assert loaded.classify(surface) == library.classify(surface)


def test_a_mapped_library_does_not_change_when_its_file_is_replaced(
    library, saved: Path, stationary
) -> None:
    surface = stationary("fine sand", 60.0, seed=3)
    loaded = load_mapped(saved)
    other = replace(library, signatures=library.signatures * 0 + 1)
    other.save(saved)
    assert loaded.classify(surface) == library.classify(surface)
    loaded.save(saved)  # over the file it comes from
    assert_equal(library, load_mapped(saved))
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]


def test_a_mapped_array_must_not_be_packed(saved: Path) -> None:
    write_members(saved, members(saved), zipfile.ZIP_DEFLATED)
    assert_refused(
        saved, r"signatures\.npy is compressed; train it again", map_from_bytes=SMALL_BYTES
    )


def test_nan_in_a_mapped_library_is_found_by_a_match(saved: Path, stationary) -> None:
    array = np.load(io.BytesIO(members(saved)["signatures.npy"]))
    array[1, 100] = np.nan
    put(saved, signatures=npy(array))
    loaded = load_mapped(saved)
    assert isinstance(loaded.signatures, np.memmap)
    with pytest.raises(LibraryError, match="contains NaN"):
        loaded.classify(stationary("sand", side=64))


@pytest.mark.parametrize(
    ("offset", "value"),
    [
        (0, b"PK\x01\x02"),  # no local header
        (26, b"\xff\xff"),  # a name of 65,535 bytes
        (26, b"\x00\x00"),  # no name
        (28, b"\xff\xff"),  # an extra field of 65,535 bytes
        (30, b"S"),  # another name
    ],
)
def test_a_changed_local_header_is_refused(saved: Path, offset: int, value: bytes) -> None:
    """The local header gives the offset of a mapped array."""
    patched(saved, "signatures.npy", {}, {offset: value})
    assert_refused(saved, UNREADABLE, map_from_bytes=SMALL_BYTES)


def test_a_large_library_keeps_its_invariants(library, saved: Path, stationary) -> None:
    library = replace(library, compare_all_up_to=2)
    library.save(saved)
    content = members(saved)
    assert "invariants.npy" in content
    assert np.load(io.BytesIO(content["invariants.npy"])).dtype == np.float32
    surface = stationary("sand", 60.0, seed=3)
    for mapped_from in (2**26, 100):
        loaded = TextureLibrary.load(saved, map_from_bytes=mapped_from)
        np.testing.assert_array_equal(loaded.invariants, library.invariants)
        assert loaded.classify(surface) == library.classify(surface)


def test_other_suffixes_and_missing_folders_are_refused(library, tmp_path: Path) -> None:
    for name in ("x.ome.tif", "x", "ps4lib"):
        with pytest.raises(LibraryError, match=r"end in \.ps4lib"):
            library.save(tmp_path / name)
    with pytest.raises(InputError, match="there is no folder"):
        library.save(tmp_path / "none" / "x.ps4lib")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["signatures", "orientations_deg", "classes"])
def test_a_library_with_altered_values_is_refused(saved: Path, name: str) -> None:
    content = members(saved)
    array = np.load(io.BytesIO(content[f"{name}.npy"])).copy()
    array.flat[0] = 0 if array.flat[0] else 1
    write_members(saved, content | {f"{name}.npy": npy(array)})
    assert_refused(saved, "does not match its SHA-256")


@pytest.mark.parametrize("map_from_bytes", [SMALL_BYTES, ps4lib.MAP_FROM_BYTES])
@pytest.mark.parametrize("given", [{}, {"sha256": None}])
def test_a_library_without_its_hash_is_refused(
    saved: Path, given: dict[str, Any], map_from_bytes: int
) -> None:
    content = members(saved)
    header = json.loads(content["library.json"])
    del header["sha256"]
    write_members(saved, content | {"library.json": json.dumps(header | given).encode()})
    assert_refused(saved, "sha256", map_from_bytes=map_from_bytes)


def test_a_mapped_library_that_is_cut_short_is_an_error(
    saved: Path, stationary, photographed
) -> None:
    surface, loaded = photographed(stationary("sand", seed=1, side=64)), load_mapped(saved)
    os.truncate(saved, 1000)
    with pytest.raises(LibraryError, match="was cut short"):
        loaded.classify(surface)
