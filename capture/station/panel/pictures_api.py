"""Pictures of stored parts, by HTTP."""

import asyncio
import base64
from concurrent.futures import Future
from dataclasses import asdict

from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from capture.station.domain.roles import Role
from capture.station.results.history import HistoryEntry
from classify.base.errors import InputError

from .api import V1, entry_of
from .part_pictures.judged_by import stored_set
from .part_pictures.painting import SIZES, PaintedPicture
from .part_pictures.picture_maker import PartPictures
from .render import JsonAnswer
from .routes import Call, PanelRoute
from .security import Denied

# Browsers keep pictures, and ask each time whether they may still show them.
_KEPT = "private, no-cache"
# A part takes a tenth of a second, and up to `MOST_WAITING` wait before it.
LONGEST_WAIT_S = 30.0
_SIZE = "; ".join(f"{name}: at most {px} px" for name, px in SIZES.items()) + "; small by default"


async def _about(call: Call) -> Response:
    """Answer with the names of the pictures of a part, and its outlined defects."""
    size, has_content, left_out = _size(call), _has_content(call), call.query.get("without")
    entry = await run_in_threadpool(entry_of, call)
    part_id, made = entry.result.part_id, await _made(call, entry)
    sent = [name for name in made.pictures if has_content and name != left_out]
    return JsonAnswer(
        {
            "part_id": part_id,
            "width_px": made.width_px,
            "height_px": made.height_px,
            "pictures": [
                {
                    "name": name,
                    "title": picture.title,
                    "caption": picture.caption,
                    "url": f"{V1}/parts/{part_id}/pictures/{name}?size={size}",
                }
                | (_content(picture) if name in sent else {})
                for name, picture in made.pictures.items()
            ],
            "defects": [
                asdict(defect) | {"outline": outline}
                for defect, outline in zip(entry.result.defects, made.outlines, strict=True)
            ],
            "notes": made.notes,
        }
    )


async def _picture(call: Call) -> Response:
    entry = await run_in_threadpool(entry_of, call)
    name, size, result = call.path["name"], _size(call), entry.result
    tag = f'"{result.set_sha256}-{result.number}-{size}-{name}"'
    headers = {"ETag": tag, "Cache-Control": _KEPT}
    if _is_known(call, tag):
        await run_in_threadpool(stored_set, call.panel.folder, entry)
        return Response(status_code=304, headers=headers)
    made = await _made(call, entry)
    if name not in made.pictures:
        known = ", ".join(made.pictures)
        raise Denied(404, f"part {result.part_id}: there is no picture {name[:40]!r}; give {known}")
    picture = made.pictures[name]
    return Response(picture.content, media_type=picture.media_type, headers=headers)


def _is_known(call: Call, tag: str) -> bool:
    known = call.request.headers.get("if-none-match", "")
    return tag in (known_tag.strip().removeprefix("W/") for known_tag in known.split(","))


def _size(call: Call) -> str:
    size = call.query.get("size", "small")
    if size not in SIZES:
        raise InputError(f"size = {size[:20]!r}: give {' or '.join(SIZES)}")
    return size


def _has_content(call: Call) -> bool:
    content = call.query.get("content", "no")
    if content not in ("yes", "no"):
        raise InputError(f"content = {content[:20]!r}: give yes or no")
    return content == "yes"


def _content(picture: PaintedPicture) -> dict[str, str]:
    content = base64.b64encode(picture.content).decode()
    return {"media_type": picture.media_type, "content": content}


async def _made(call: Call, entry: HistoryEntry) -> PartPictures:
    part, size = f"part {entry.result.part_id}", _size(call)

    def asked() -> Future[PartPictures] | None:
        path = stored_set(call.panel.folder, entry)
        return call.panel.pictures.ask(entry.result, path, size)

    future = await run_in_threadpool(asked)
    if future is None:
        text = f"{part}: too many parts wait for pictures"
        raise Denied(503, text, {"Retry-After": "2"})
    made = asyncio.wrap_future(future)
    # asyncio logs an exception that nobody retrieves: all requests may have ended.
    made.add_done_callback(lambda made: made.cancelled() or made.exception())
    # Shielded, because others may wait for the same pictures.
    try:
        return await asyncio.wait_for(asyncio.shield(made), LONGEST_WAIT_S)
    except TimeoutError:
        raise Denied(503, f"{part}: its pictures are being made", {"Retry-After": "2"}) from None
    except InputError as error:
        raise Denied(409, f"{part}: no pictures can be made: {error}") from error


ROUTES = (
    PanelRoute(
        "GET", f"{V1}/parts/{{part_id}}/pictures", Role.OPERATOR, _about,
        "The pictures of a part with captions, and its defects with outlines.",
        query={"size": _SIZE, "content": "yes: with the pictures, as media_type and base64",
               "without": "name of a picture of which no content is needed"},
    ),
    PanelRoute(
        "GET", f"{V1}/parts/{{part_id}}/pictures/{{name}}", Role.OPERATOR, _picture,
        "A picture of a part, made from its stored set: light-0 and so on, albedo, relief, shadow, "
        "normals, defects, defect-map; slopes at the large size.",
        query={"size": _SIZE}, answer="image/jpeg",
    ),
)  # fmt: skip
