"""How calls of the API are described: what they answer, and what else may happen."""

from typing import Annotated, Any, get_type_hints

from fastapi import Response
from pydantic import BaseModel, Field, create_model

from capture.base.names import NAME_PATTERN
from classify.base.models import Record

Name = Annotated[str, Field(pattern=NAME_PATTERN)]


def answer(model: str, base: type[BaseModel] = Record, /, **fields: Any) -> type[BaseModel]:
    """Return the model of an answer with these fields; a tuple is a type and its default."""
    for key, kind in fields.items():
        fields[key] = kind if isinstance(kind, tuple) else (kind, ...)
    return create_model(model, __base__=base, **fields)


def fields_of(kind: type, *left_out: str) -> dict[str, Any]:
    """Return the fields of a dataclass for `answer`."""
    return {name: kind for name, kind in get_type_hints(kind).items() if name not in left_out}


def media(media_type: str) -> dict[str, Any]:
    """Return the description of a call whose answer is no JSON."""
    schema = {"type": "string"} | ({"format": "binary"} if media_type.startswith("image") else {})
    content = {media_type: {"schema": schema}}
    return {"response_class": Response, "responses": {200: {"content": content}}}


def refused(**also: Any) -> dict[str, Any]:
    """Return the description of an answer with an error, and with further fields."""
    name = "Failure" + "".join(key.title() for key in also)
    return {"model": answer(name, error=str, **also), "description": "not served"}


_FAILURE = refused()
ERRORS: dict[int | str, dict[str, Any]] = {
    401: _FAILURE | {"headers": {"WWW-Authenticate": {"schema": {"type": "string"}}}},
    "4XX": _FAILURE,
    503: _FAILURE | {"headers": {"Retry-After": {"schema": {"type": "integer"}}}},
}
