"""Descriptions of the calls of the API: their answers and errors."""

from dataclasses import is_dataclass
from typing import Annotated, Any, get_type_hints

from fastapi import Response
from pydantic import BaseModel, Field, create_model

from capture.base.names import NAME_PATTERN
from classify.base.models import Record

Name = Annotated[str, Field(pattern=NAME_PATTERN)]


def answer(model: str, base: type = Record, /, *left_out: str, **fields: Any) -> type[BaseModel]:
    """Return the model of an answer: fields of a model or dataclass, and `fields`.

    A field that is a tuple has a type and a default.
    """
    if is_dataclass(base):
        known = {key: kind for key, kind in get_type_hints(base).items() if key not in left_out}
        base, fields = Record, known | fields
    model_fields: dict[str, Any] = {
        key: kind if isinstance(kind, tuple) else (kind, ...) for key, kind in fields.items()
    }
    return create_model(model, __base__=base, **model_fields)


def media(media_type: str) -> dict[str, Any]:
    """Return the description of a call whose answer is no JSON."""
    schema = {"type": "string"} | ({"format": "binary"} if media_type.startswith("image") else {})
    content = {media_type: {"schema": schema}}
    return {"response_class": Response, "responses": {200: {"content": content}}}


_FAILURE = {
    "description": "not served",
    "model": answer(
        "Failure",
        error=str,
        accepted=(bool, Field(False, description="of a trigger")),
        kind=(str, Field("", description="of a refusal to load a recipe")),
        settings=(dict[str, str], Field({}, description="messages by wrong setting")),
    ),
}
ERRORS: dict[int | str, dict[str, Any]] = {
    401: _FAILURE | {"headers": {"WWW-Authenticate": {"schema": {"type": "string"}}}},
    "4XX": _FAILURE,
    503: _FAILURE | {"headers": {"Retry-After": {"schema": {"type": "integer"}}}},
}
