"""Pictures of stored parts by HTTP, of a station whose rig is fake."""

import base64
import threading
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

import cv2
import numpy as np
import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.panel import part_pictures, pictures_api
from capture.station.panel.part_pictures import MAX_WAITING, PaintedPicture
from capture.station.results.history import Selection
from capture.station.results.removals import record_removals
from rig.set_file import pixels_sha256
from tests.capture.station.panel.panels import RunningPanel

UTC = "2026-11-22T17:08:13.042Z"
NAMES = {f"light-{number}" for number in range(4)} | {
    "albedo", "relief", "shadow", "normals", "defects",
}  # fmt: skip


def decoded(content: bytes) -> np.ndarray:
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    return picture


def set_file(panel: RunningPanel, part_id: str) -> Path:
    entry = next(panel.bench.store.parts(Selection(part_id=part_id)))
    assert entry.result.set_file is not None
    return panel.bench.folder.path / entry.result.set_file


def test_a_stored_part_has_all_its_pictures(panel: RunningPanel) -> None:
    (part_id,) = panel.parts(1)
    about = panel.local.get(f"/api/v1/parts/{part_id}/pictures").json
    assert {each["name"] for each in about["pictures"]} == NAMES
    assert (about["width_px"], about["height_px"]) == (32, 32)
    for each in about["pictures"]:
        answer = panel.local.get(each["url"])
        assert answer.status == 200
        assert answer.headers["content-type"] == "image/jpeg"
        assert answer.headers["cache-control"] == "private, no-cache"
        assert decoded(answer.body).shape == (32, 32, 3)
        assert each["caption"]
    large = panel.local.get(f"/api/v1/parts/{part_id}/pictures?size=large").json
    assert {each["name"] for each in large["pictures"]} == NAMES | {"slopes"}
    # The station's recipe is not taught: the page says how the pictures differ from a judgement.
    assert "solved by the default method" in about["notes"][0]


def test_the_slopes_are_the_normals_in_twelve_bits(
    panel: RunningPanel, captured: CapturedSet
) -> None:
    (part_id,) = panel.parts(1)
    answer = panel.local.get(f"/api/v1/parts/{part_id}/pictures/slopes?size=large")
    assert answer.headers["content-type"] == "image/png"
    blue, green, red = np.moveaxis(decoded(answer.body).astype(int), 2, 0)
    x = (red * 16 + blue // 16) / 4095 * 2 - 1
    y = (green * 16 + blue % 16) / 4095 * 2 - 1
    normals = captured.solve(planar=True).normals
    assert np.abs(x - normals[..., 0]).max() < 3e-4
    assert np.abs(y - normals[..., 1]).max() < 3e-4


def test_a_browser_that_has_the_picture_gets_no_second_one(panel: RunningPanel) -> None:
    (part_id,) = panel.parts(1)
    path = f"/api/v1/parts/{part_id}/pictures/albedo"
    first = panel.local.get(path)
    again = panel.local.get(path, If_None_Match=f'"x", W/{first.headers["etag"]}')
    assert (again.status, again.body) == (304, b"")
    assert panel.local.get(f"{path}?size=large", If_None_Match=first.headers["etag"]).status == 200


@pytest.mark.parametrize(
    ("path", "status", "said"),
    [
        ("PART/pictures/x", 404, "there is no picture 'x'; give light-0"),
        ("PART/pictures/" + quote("../../station.toml", safe=""), 404, ""),
        ("PART/pictures/albedo?size=huge", 400, "size: "),
        ("nobody/pictures/albedo", 404, "there is no result"),
        (quote("../x", safe="") + "/pictures/albedo", 404, ""),
    ],
)
def test_no_name_leads_to_another_file(
    panel: RunningPanel, path: str, status: int, said: str
) -> None:
    (part_id,) = panel.parts(1)
    answer = panel.local.get(f"/api/v1/parts/{path.replace('PART', part_id)}")
    assert answer.status == status
    assert said in answer.json["error"]


def test_a_set_that_was_removed_or_damaged_or_exchanged_is_an_error_that_says_so(
    panel: RunningPanel, captured: CapturedSet
) -> None:
    part_id, other = panel.parts(2)
    path, kept = set_file(panel, part_id), panel.local.get(f"/api/v1/parts/{part_id}/set").body
    address = f"/api/v1/parts/{part_id}/pictures/albedo"

    path.write_bytes(kept[: len(kept) // 2])
    answer = panel.local.get(address)
    assert answer.status == 409
    assert "no pictures can be made" in answer.json["error"]
    other_images = captured.images[::-1].copy()
    sha256 = pixels_sha256(other_images, captured.ambient, None)
    about = captured.metadata.model_copy(update={"pixels_sha256": sha256})
    CapturedSet(other_images, captured.ambient, about).save(path)
    assert "another set than the one that was judged" in panel.local.get(address).json["error"]

    path.unlink()
    assert panel.local.get(address).status == 404
    entry = next(panel.bench.store.parts(Selection(part_id=part_id)))
    assert entry.result.set_file is not None
    record_removals(panel.bench.store, {part_id: entry.result.set_file}, UTC)
    answer = panel.local.get(address)
    assert answer.status == 410
    assert "removed by the retention on 2026-11-22" in answer.json["error"]
    assert panel.local.get(f"/api/v1/parts/{other}/pictures/albedo").status == 200


def test_pictures_are_made_once_for_all_who_ask_and_a_full_queue_says_so(
    panel: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    (part_id,) = panel.parts(1)
    going_on, made = threading.Event(), []

    def slow(*about: object) -> dict[str, object]:
        made.append(about)
        assert going_on.wait(60)
        return {}

    monkeypatch.setattr(part_pictures, "painted", slow)
    result = next(panel.bench.store.parts(Selection(part_id=part_id))).result
    path, maker = set_file(panel, part_id), panel.panel.pictures
    future = maker.request(result, path, "small")
    assert maker.request(result, path, "small") is future
    others = [replace(result, part_id=f"other-{number}") for number in range(MAX_WAITING)]
    asked = [maker.request(other, path, "small") for other in others]
    assert [each is None for each in asked] == [False] * (MAX_WAITING - 1) + [True]
    full = panel.local.get(f"/api/v1/parts/{part_id}/pictures?size=large")
    assert (full.status, full.headers["retry-after"]) == (503, "2")
    assert panel.local.get("/api/v1/state").status == 200  # other requests are served
    going_on.set()
    assert future.result(60).pictures == {}
    assert len(made) <= MAX_WAITING


def test_the_memory_of_kept_pictures_is_bounded(
    panel: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    (part_id,) = panel.parts(1)
    made: list[str] = []
    content = bytes(1000)

    def paint(_: object, size: str) -> dict[str, PaintedPicture]:
        made.append(size)
        return {"albedo": PaintedPicture("", "", "image/jpeg", content)}

    monkeypatch.setattr(part_pictures, "painted", paint)
    monkeypatch.setattr(part_pictures, "MAX_CACHE_BYTES", 2500)
    result = next(panel.bench.store.parts(Selection(part_id=part_id))).result
    path, maker = set_file(panel, part_id), panel.panel.pictures

    def ask(number: int) -> None:
        future = maker.request(replace(result, part_id=f"part-{number}"), path, "small")
        assert future.result(60).pictures["albedo"].content == content

    for number in (1, 2, 1, 3, 1, 2):  # 2 is dropped for 3: 1 was asked for later
        ask(number)
    assert len(made) == 4


def test_the_description_brings_the_pictures_along_if_asked(panel: RunningPanel) -> None:
    (part_id,) = panel.parts(1)
    address = f"/api/v1/parts/{part_id}/pictures"
    assert "content" not in panel.local.get(address).json["pictures"][0]
    for each in panel.local.get(f"{address}?content=yes").json["pictures"]:
        assert each["media_type"] == "image/jpeg"
        assert base64.b64decode(each["content"]) == panel.local.get(each["url"]).body
    partly = panel.local.get(f"{address}?content=yes&without=normals").json["pictures"]
    assert [each["name"] for each in partly if "content" not in each] == ["normals"]
    assert panel.local.get(f"{address}?content=all").status == 400


def test_pictures_that_take_too_long_are_an_answer_to_be_tried_again(
    panel: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    (part_id,) = panel.parts(1)
    going_on = threading.Event()
    monkeypatch.setattr(pictures_api, "MAX_WAIT_S", 0.05)
    monkeypatch.setattr(part_pictures, "made_pictures", lambda *_: going_on.wait(60))
    answer = panel.local.get(f"/api/v1/parts/{part_id}/pictures")
    going_on.set()
    assert (answer.status, answer.headers["retry-after"]) == (503, "2")
