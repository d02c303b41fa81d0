"""Tests of the hash of images that arrive one by one."""

import threading
import time
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.acquisition.attempts import capture_set
from capture.sets.captured_set import CapturedSet
from capture.sets.ome_tiff import PixelHash
from classify.base.errors import InputError
from classify.base.threads import set_thread_count
from rig import RigConfig, open_rig
from rig.set_file import pixels_sha256

PLANES = np.random.default_rng(1).integers(0, 65536, (6, 5, 7), dtype=np.uint16)


@given(st.permutations(range(6)), st.integers(1, 6), st.sampled_from([1, 2, None]))
def test_the_hash_of_pages_in_any_order_is_that_of_the_whole(
    order: list[int], pages: int, threads: int | None
) -> None:
    hashed = PixelHash()
    set_thread_count(threads)
    try:
        for page in order:
            if page < pages:
                assert not hashed.has(page)
                hashed.add(page, PLANES[page])
                assert hashed.has(page)
        assert hashed.sha256() == hashed.sha256() == pixels_sha256(PLANES[:pages])
    finally:
        set_thread_count(None)


def test_pages_that_come_at_once_are_hashed_by_any_number_of_threads() -> None:
    def hash_sets() -> None:
        for _ in range(300):
            hashed = PixelHash()
            for page, plane in enumerate(planes):
                hashed.add(page, plane)
            time.sleep(1e-4)
            found.add(hashed.sha256())

    planes, found = np.tile(PLANES, (1, 20, 20)), set[str]()
    set_thread_count(4)
    try:
        thread = threading.Thread(target=hash_sets, daemon=True)
        thread.start()
        thread.join(60.0)
    finally:
        set_thread_count(None)
    assert not thread.is_alive()
    assert found == {pixels_sha256(planes)}


def test_pages_of_any_layout_are_hashed_as_rows() -> None:
    hashed = PixelHash()
    hashed.add(0, PLANES[0].T)
    hashed.add(1, PLANES[1].T[:, ::-1])
    assert hashed.sha256() == pixels_sha256(np.stack([PLANES[0].T, PLANES[1].T[:, ::-1]]))


def test_a_page_that_is_missing_or_comes_twice_is_refused() -> None:
    hashed = PixelHash()
    hashed.add(1, PLANES[1])
    with pytest.raises(ValueError, match="page 0 is missing"):
        hashed.sha256()
    hashed.add(0, PLANES[0])
    for page in (0, 1):
        with pytest.raises(ValueError, match="a second time"):
            hashed.add(page, PLANES[page])


def test_pixels_are_hashed_once_from_capture_to_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = RigConfig().with_changes(camera={"width_px": 32, "height_px": 32})
    with open_rig(small) as rig:
        captured = capture_set(rig)
    hashed = Mock(wraps=pixels_sha256)
    monkeypatch.setattr("capture.sets.ome_tiff.pixels_sha256", hashed)
    captured.save(tmp_path / "a.ome.tif")
    assert hashed.call_count == 0
    assert CapturedSet.load(tmp_path / "a.ome.tif").metadata == captured.metadata
    other = replace(captured, images=captured.images + np.uint16(1))
    with pytest.raises(InputError, match="pixels_sha256 in the metadata"):
        other.save(tmp_path / "b.ome.tif")
