"""Maps as TIFF files: what was written is read, and damage is an error with the name."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from capture.maps.map_tiff import read_description, read_map, write_channels, write_values
from classify.base.errors import InputError

ABOUT = st.fixed_dictionaries({"pixels_sha256": st.text(), "label": st.none() | st.text()})
SCALES = st.none() | st.floats(1e-6, 1e3)
FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False)


def shapes(dimensions: int) -> st.SearchStrategy[tuple[int, ...]]:
    return st_numpy.array_shapes(min_dims=dimensions, max_dims=dimensions, max_side=6)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("maps") / "a.tif"


@settings(max_examples=30)
@given(
    values=shapes(2).flatmap(lambda s: st_numpy.arrays("f4", s, elements=FLOATS)),
    about=ABOUT,
    mm_per_px=SCALES,
)
def test_values_and_description_come_back(
    path: Path, values: Any, about: dict[str, Any], mm_per_px: float | None
) -> None:
    write_values(path, values, about, mm_per_px)
    read, described = read_map(path)
    np.testing.assert_array_equal(read, values)
    assert described == about == read_description(path)


@settings(max_examples=30)
@given(
    channels=shapes(3).flatmap(lambda s: st_numpy.arrays("f4", s, elements=FLOATS))
    | shapes(2).flatmap(lambda s: st_numpy.arrays("u1", s)),
    about=ABOUT,
    mm_per_px=SCALES,
)
def test_channels_and_description_come_back(
    path: Path, channels: Any, about: dict[str, Any], mm_per_px: float | None
) -> None:
    names = tuple(map(str, range(len(channels) if channels.ndim == 3 else 1)))
    write_channels(path, channels, names, (0.0, 1.0), about, mm_per_px)
    read, described = read_map(path)
    np.testing.assert_array_equal(np.squeeze(read), np.squeeze(channels))
    assert read.dtype == channels.dtype
    assert described == about == read_description(path)
    np.testing.assert_array_equal(np.squeeze(tifffile.imread(path)), np.squeeze(channels))


@settings(max_examples=60)
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7), cut=st.booleans())
def test_damage_is_an_error_with_the_name_or_changes_a_value(
    path: Path, place: float, bit: int, cut: bool
) -> None:
    write_channels(
        path, np.ones((3, 9, 9), "f4"), ("x", "y", "z"), (0, 1), {"pixels_sha256": ""}, None
    )
    content = bytearray(path.read_bytes())
    at = int(place * len(content))
    if cut:
        del content[at:]
    else:
        content[at] ^= 1 << bit
    path.write_bytes(content)
    with suppress(InputError):
        read_map(path)


def test_a_map_that_declares_more_than_it_holds_is_refused(path: Path) -> None:
    write_values(path, np.ones((9, 9), np.float32), {"pixels_sha256": ""}, None)
    with tifffile.TiffFile(path, mode="r+") as tiff:
        tiff.pages.first.tags["ImageLength"].overwrite(30000)
        tiff.pages.first.tags["ImageWidth"].overwrite(30000)
    with pytest.raises(InputError, match=r"a.tif: "):
        read_map(path)
