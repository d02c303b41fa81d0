"""Error messages of wrong TOML files, in one line: key, value and remedy."""

import difflib
import json
from typing import Any

from pydantic import BaseModel, ValidationError

from rig.cameras.config import CAMERA_KINDS

_MISSING = {
    "device": "give the camera's path, best its name in /dev/v4l/by-id",
    "set_file": "give the set to replay",
}


def validation_message(error: ValidationError, root: type[BaseModel]) -> str:
    """Describe an error of `root`; a misspelt key precedes the key that it should have been."""
    errors = error.errors(include_url=False)
    first = next((each for each in errors if each["type"] == "extra_forbidden"), errors[0])
    location, value, cause = list(first["loc"]), first["input"], first["msg"]
    kind = str(location.pop(1)) if location[:1] == ["camera"] and len(location) > 1 else None
    field = ".".join(map(str, location))
    match first["type"]:
        case "value_error":  # names key and value itself
            return ": ".join(filter(None, (field, cause.removeprefix("Value error, "))))
        case "missing":
            remedy = _MISSING.get(str(location[-1]), "give it")
            return f"{field} is missing; {remedy}"
        case "extra_forbidden" | "unexpected_keyword_argument":
            return f"{field} = {_toml(value)}: {_unknown_key(location, kind, root)}"
        case "union_tag_invalid":
            kinds = ", ".join(map(repr, CAMERA_KINDS))
            return f"camera.kind = {_toml(value['kind'])}: must be one of {kinds}"
        case "too_short" | "too_long":
            limits = first["ctx"]
            bound = (
                f"at least {limits['min_length']}"
                if first["type"] == "too_short"
                else f"at most {limits['max_length']}"
            )
            return f"{field} has {limits['actual_length']} values: must have {bound}"
        case "model_type" | "model_attributes_type" | "dict_type":
            return f"{field} = {_toml(value)}: must be a table, [{field}]"
    return f"{field} = {_toml(value)}: {_in_words(cause)}"


def first_fault(error: ValidationError) -> str:
    """Return place and text of the first error of a file that this program wrote."""
    first = error.errors(include_url=False)[0]
    place = ".".join(map(str, first["loc"])) or "the file"
    return f"{place}: {first['msg']}"


def messages_by_place(error: ValidationError) -> dict[tuple[str | int, ...], str]:
    """Return what is wrong with each value, by its place, for a form that shows the value."""
    return {each["loc"]: _in_words(each["msg"]) for each in error.errors(include_url=False)}


def _in_words(cause: str) -> str:
    """Rewrite a message of pydantic in the wording of this program."""
    cause = cause.removeprefix("Value error, ").replace("Field required", "is missing; give it")
    for old, new in (("Input should", "must"), ("should", "must"), ("valid integer", "integer")):
        cause = cause.replace(old, new)
    return cause.replace("a integer", "an integer").replace("a valid", "a")


def _unknown_key(location: list[Any], kind: str | None, root: type[BaseModel]) -> str:
    key = str(location[-1])
    others = [name for name, model in CAMERA_KINDS.items() if key in model.model_fields]
    if kind is not None and others:
        return f"not a key of kind = {kind!r}; leave it out, or set kind = " + " or ".join(
            map(repr, others)
        )
    model: Any = CAMERA_KINDS[kind] if kind is not None else root
    for part in location[:-1] if kind is None else ():
        model = getattr(getattr(model, "model_fields", {}).get(part), "annotation", None)
    keys = list(getattr(model, "model_fields", ()))
    near = difflib.get_close_matches(key, keys, 1)
    if near:
        return f"unknown key; did you mean {near[0]}?"
    return "unknown key; " + (f"the keys are {', '.join(keys)}" if keys else "leave it out")


def _toml(value: object) -> str:
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."
