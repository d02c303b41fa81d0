"""Keys of TOML and JSON files as Markdown, from the models that read them."""

import inspect
import math
import re
from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple, get_args, get_origin

from pydantic import BaseModel

from rig.cameras.config import CameraConfig
from rig.cameras.kinds import CAMERA_KINDS

REQUIRED = "required"
# A larger bound only keeps numbers finite.
_LARGEST_BOUND = 1e5


class Key(NamedTuple):
    """One key of a section; `models` read its value if that is a section of its own."""

    name: str
    default: str
    values: str
    meaning: str
    models: tuple[type, ...]
    is_many: bool


def sections(model: type, name: str = "") -> list[str]:
    """Return a line for each key of a model, and for those of the sections below it."""
    return list(_sections(name, (model,), set()))


def fields(model: type) -> list[str]:
    """Return a line for each field of a model, and none for the fields below them."""
    return [f"- `{key.name}` {key.meaning}" for key in keys_of(model)]


def _sections(name: str, kinds: Sequence[type], listed: set[type]) -> Iterator[str]:
    keys = _merged(kinds)
    meanings: dict[str, str] = {}
    for key in keys:
        if not key.models:
            first = meanings.setdefault(key.meaning, key.name)
            yield _line(key if first == key.name else key._replace(meaning=f"as `{first}`"))
    for key in keys:
        models = [
            each for each in key.models if not any(issubclass(known, each) for known in listed)
        ]
        listed.update(models)
        if key.models:
            path = f"{name.strip('[]')}.{key.name}".strip(".")
            section = f"[[{path}]]" if key.is_many else f"[{path}]"
            yield from ("", f"## `{section}`", "")
            yield from (key.meaning[0].upper() + key.meaning[1:] + ".", "") if key.meaning else ()
            yield from _sections(section, models, listed)


def _line(key: Key) -> str:
    default = f" = {key.default}" if key.default not in ("", REQUIRED) else ""
    values = "; ".join(filter(None, [REQUIRED * (key.default == REQUIRED), key.values]))
    return f"- `{key.name}{default}` {key.meaning}" + (f" [{values}]" if values else "")


def _merged(kinds: Sequence[type]) -> list[Key]:
    """The keys of all kinds; one of some kinds only, or of several meanings, names its kinds."""
    keys = [{key.name: key for key in keys_of(kind)} for kind in kinds]
    merged: dict[str, Key] = {}
    for key in (each for own in keys for each in own.values() if each.name not in merged):
        having: dict[str, list[str]] = {}  # kinds, by meaning
        for own in keys:
            if {"kind", key.name} <= own.keys():
                having.setdefault(own[key.name].meaning, []).append(own["kind"].values)
        lacking = [own["kind"].values for own in keys if "kind" in own and key.name not in own]
        meaning = "".join(f"all but {kind}: " for kind in lacking) + key.meaning
        if len(having) > 1 or len(lacking) > 1:
            meaning = "; ".join(f"{', '.join(kinds)}: {text}" for text, kinds in having.items())
        named = [own[key.name].values for own in keys if key.name in own]
        values = ", ".join(dict.fromkeys(", ".join(filter(None, named)).split(", ")))
        merged[key.name] = key._replace(values=values, meaning=meaning)
    return list(merged.values())


def keys_of(model: type) -> list[Key]:
    """Return the keys of a pydantic model or a dataclass; ValueError if one is not described."""
    keys = list(_model_keys(model))
    for key in keys:
        if not (key.meaning or key.models):
            raise ValueError(f"{model.__name__}.{key.name} has no description; give it one")
    return keys


def _model_keys(model: type[BaseModel]) -> Iterator[Key]:
    for name, field in model.model_fields.items():
        described = [
            each.model_fields[name].description
            for each in model.__mro__
            if issubclass(each, BaseModel) and name in each.model_fields
        ]
        meaning = next(filter(None, described), None) or _attributes(model).get(name, "")
        meaning = meaning[:1].lower() + meaning[1:] if meaning[1:2].islower() else meaning
        default = (
            REQUIRED
            if field.is_required()
            else _shown(field.get_default(call_default_factory=True))
        )
        alias = field.alias or name
        yield _key(alias, field.annotation, default, _range(field.metadata), meaning)


def _key(name: str, hint: Any, default: str, values: str, meaning: str) -> Key:
    models = tuple(dict.fromkeys(_models(hint)))
    choices = ", ".join(dict.fromkeys(_choices(hint)))
    is_many = any(get_origin(each) is tuple for each in (hint, *get_args(hint)))
    return Key(name, "" if models else default, choices or values, meaning, models, is_many)


def _models(hint: Any) -> Iterator[type]:
    if hint is CameraConfig:
        yield from (kind.config for kind in CAMERA_KINDS.values())
    elif isinstance(hint, type) and issubclass(hint, BaseModel):
        yield hint
    for each in get_args(hint):
        yield from _models(each)


def _choices(hint: Any) -> Iterator[str]:
    if get_origin(hint) is Literal:
        yield from map(str, get_args(hint))
    else:
        for each in get_args(hint):
            yield from _choices(each)


def _shown(value: Any) -> str:
    """A default as TOML; nothing for one that no file can state."""
    if value in (None, "", (), {}):
        return ""
    match value:
        case bool():
            return str(value).lower()
        case float():
            return f"{value:g}" if math.isfinite(value) else ""
        case tuple() | list():
            return f"[{', '.join(map(_shown, value))}]"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _range(metadata: Sequence[Any]) -> str:
    """The bounds of a number."""
    names = ("ge", "gt", "le", "lt")
    bounds = {
        name: getattr(each, name) for each in metadata for name in names if hasattr(each, name)
    }
    least, most = bounds.get("ge", bounds.get("gt")), bounds.get("le", bounds.get("lt"))
    if least is None or most is None or most > _LARGEST_BOUND:
        return ""
    return f"{'> ' * ('gt' in bounds)}{least:g} to {'< ' * ('lt' in bounds)}{most:g}"


def _attributes(model: type) -> dict[str, str]:
    """Meanings from the section "Attributes" of a docstring in numpy's form."""
    lines = (inspect.getdoc(model) or "").partition("Attributes\n----------\n")[2]
    found = re.findall(r"^(\w[\w, ]*)\n((?:    .*\n?)+)", lines, re.MULTILINE)
    return {
        name: " ".join(text.split()).rstrip(".")
        for names, text in found
        for name in names.split(", ")
    }
