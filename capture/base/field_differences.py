"""Fields in which two mappings differ."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class FieldDifference:
    """A field and its value on either side; None where one does not have it."""

    field: str
    first: Any
    second: Any


def field_differences(
    first: Mapping[str, Any], second: Mapping[str, Any], name: str = ""
) -> Iterator[FieldDifference]:
    """Yield the fields that differ, as paths with dots; lists are compared as a whole."""
    for key in dict.fromkeys([*first, *second]):
        one, other = first.get(key), second.get(key)
        path = f"{name}.{key}" if name else key
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            yield from field_differences(one, other, path)
        elif one != other:
            yield FieldDifference(path, one, other)
