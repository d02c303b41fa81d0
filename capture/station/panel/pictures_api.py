"""Pictures of stored parts, by HTTP."""

import asyncio
import base64
from concurrent.futures import Future
from dataclasses import asdict
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import conlist
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from capture.station.results.history import HistoryEntry
from capture.station.results.part_result import DefectRecord
from classify.base.errors import InputError

from .answers import JsonAnswer, answer, media
from .api import entry_of
from .guard import V1, ByOperator, Call
from .judged_by import stored_set
from .part_pictures import SIZES, PaintedPicture, PartPictures
from .part_view import Outline
from .security import Denied

# Browsers cache pictures, and revalidate them before each use.
_CACHE_CONTROL = "private, no-cache"
# The pictures of a part take 0.1 s, and up to `part_pictures.MAX_WAITING` parts wait before it.
MAX_WAIT_S = 30.0
_Size = Annotated[
    Literal["small", "large"],
    Query(description="; ".join(f"{name}: at most {px} px" for name, px in SIZES.items())),
]
router = APIRouter(prefix=f"{V1}/parts/{{part_id}}/pictures")


_Picture = answer(
    "Picture", name=str, title=str, caption=str, url=str, media_type=(str, ""), content=(str, "")
)
_OutlinedDefect = answer("OutlinedDefect", DefectRecord, outline=Outline)
_Pictures = answer(
    "Pictures",
    part_id=str,
    width_px=int,
    height_px=int,
    pictures=conlist(_Picture),
    defects=conlist(_OutlinedDefect),
    notes=list[str],
)


@router.get("", response_model=_Pictures)
async def _pictures(
    call: ByOperator,
    part_id: str,
    size: _Size = "small",
    content: Annotated[
        Literal["yes", "no"],
        Query(description="yes: with the pictures, as media_type and base64"),
    ] = "no",
    without: Annotated[
        str | None, Query(description="name of a picture of which no content is needed")
    ] = None,
) -> Response:
    """The pictures of a part with captions, and its defects with outlines."""
    entry = await run_in_threadpool(entry_of, call.panel, part_id)
    pictures = await _pictures_of(call, entry, size)
    sent = [name for name in pictures.pictures if content == "yes" and name != without]
    return JsonAnswer(
        {
            "part_id": part_id,
            "width_px": pictures.width_px,
            "height_px": pictures.height_px,
            "pictures": [
                {
                    "name": name,
                    "title": picture.title,
                    "caption": picture.caption,
                    "url": f"{V1}/parts/{part_id}/pictures/{name}?size={size}",
                }
                | (_content(picture) if name in sent else {})
                for name, picture in pictures.pictures.items()
            ],
            "defects": [
                asdict(defect) | {"outline": outline}
                for defect, outline in zip(entry.result.defects, pictures.outlines, strict=True)
            ],
            "notes": pictures.notes,
        }
    )


@router.get("/{name}", **media("image/jpeg"))
async def _picture(call: ByOperator, part_id: str, name: str, size: _Size = "small") -> Response:
    """A picture of a part, made from its stored set.

    Its name is light-0 and so on, albedo, relief, shadow, normals, defects or defect-map; slopes
    at the large size.
    """
    entry = await run_in_threadpool(entry_of, call.panel, part_id)
    result = entry.result
    tag = f'"{result.set_sha256}-{result.number}-{size}-{name}"'
    headers = {"ETag": tag, "Cache-Control": _CACHE_CONTROL}
    if _is_known(call, tag):
        await run_in_threadpool(stored_set, call.panel.folder, entry)
        return Response(status_code=304, headers=headers)
    pictures = await _pictures_of(call, entry, size)
    if name not in pictures.pictures:
        known = ", ".join(pictures.pictures)
        raise Denied(404, f"part {result.part_id}: there is no picture {name[:40]!r}; give {known}")
    picture = pictures.pictures[name]
    return Response(picture.content, media_type=picture.media_type, headers=headers)


def _is_known(call: Call, tag: str) -> bool:
    known = call.request.headers.get("if-none-match", "")
    return tag in (known_tag.strip().removeprefix("W/") for known_tag in known.split(","))


def _content(picture: PaintedPicture) -> dict[str, str]:
    content = base64.b64encode(picture.content).decode()
    return {"media_type": picture.media_type, "content": content}


async def _pictures_of(call: Call, entry: HistoryEntry, size: str) -> PartPictures:
    part = f"part {entry.result.part_id}"

    def request() -> Future[PartPictures] | None:
        path = stored_set(call.panel.folder, entry)
        return call.panel.pictures.request(entry.result, path, size)

    future = await run_in_threadpool(request)
    if future is None:
        text = f"{part}: too many parts wait for pictures"
        raise Denied(503, text, {"Retry-After": "2"})
    pictures = asyncio.wrap_future(future)
    # asyncio logs an exception that nobody retrieves, for example after all requests have ended.
    pictures.add_done_callback(lambda pictures: pictures.cancelled() or pictures.exception())
    # Shielded, because others may wait for the same pictures.
    try:
        return await asyncio.wait_for(asyncio.shield(pictures), MAX_WAIT_S)
    except TimeoutError:
        raise Denied(503, f"{part}: its pictures are being made", {"Retry-After": "2"}) from None
    except InputError as error:
        raise Denied(409, f"{part}: no pictures can be made: {error}") from error
