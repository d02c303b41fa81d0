"""Change single values in a TOML file, keeping its comments and order."""

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from classify.durable_file import durable_file
from rig.errors import ConfigError

from .rig import load_config

_SCALAR = r""" "(?:[^"\\]|\\.)*" | '[^']*' | [^\s\#"'\[{]+ """
_LINE = r"""^(?P<before>[ \t]*(?:{key}|"{key}"|'{key}')[ \t]*=[ \t]*)(?:{scalar})(?P<after>.*)$"""
_HEADER = re.compile(r"^[ \t]*\[")


def with_values(text: str, section: str, values: Mapping[str, str | float]) -> str:
    """Set `values` in ``[section]`` of a TOML text; everything else stays as it is.

    An existing key gets its new value in place, new keys follow the section's last line, and a new
    section comes last. The result is parsed again: if it is not the old configuration with just
    these values, because the file uses dotted keys or inline tables, it is refused.
    """
    # Not splitlines, which also splits at characters that TOML allows in comments.
    lines = text.removesuffix("\n").split("\n") if text else []
    ending = "\r" if "\r\n" in text else ""
    written = {key: _written(value) for key, value in values.items()}
    start = next((n for n, line in enumerate(lines) if _is_header(line, section)), None)
    if start is None:
        lines += [*([ending] if lines else []), f"[{section}]{ending}"]
        start = len(lines) - 1
    following = (n for n in range(start + 1, len(lines)) if _HEADER.match(lines[n]))
    end = next(following, len(lines))
    added = []
    for key, value in written.items():
        pattern = re.compile(_LINE.format(key=re.escape(key), scalar=_SCALAR), re.VERBOSE)
        for number in range(start + 1, end):
            match = pattern.match(lines[number])
            if match:
                lines[number] = f"{match['before']}{value}{match['after']}"
                break
        else:
            added.append(f"{key} = {value}{ending}")
    # Insert above the blank lines and comments that introduce the next section.
    while end > start + 1 and not lines[end - 1].partition("#")[0].strip():
        end -= 1
    lines[end:end] = added
    changed = "\n".join(lines) + "\n"
    if not _is_just(text, changed, section, values):
        by_hand = "; ".join(f"{key} = {value}" for key, value in written.items())
        raise ConfigError(
            f"section [{section}] is not written as lines of key = value, so it cannot be changed "
            f"in place; add by hand: {by_hand}"
        )
    return changed


def store_values(path: Path, sections: Mapping[str, Mapping[str, str | float]]) -> None:
    """Change values in a ``rig.toml`` as `with_values` does, atomically."""
    text = path.read_bytes().decode()
    for section, values in sections.items():
        text = with_values(text, section, values)
    # Resolved, so that a symbolic link stays and its target changes.
    with durable_file(path.resolve()) as temporary:
        temporary.chmod(path.stat().st_mode)
        temporary.write_bytes(text.encode())
        try:
            load_config(temporary)
        except ConfigError as error:
            raise ConfigError(str(error).replace(str(temporary), str(path))) from error


def _written(value: str | float) -> str:
    # A printable text has the same form in JSON and TOML.
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else f"{value:g}"


def _is_header(line: str, section: str) -> bool:
    return re.match(rf"^[ \t]*\[[ \t]*{re.escape(section)}[ \t]*\]\s*(#.*)?$", line) is not None


def _is_just(old: str, new: str, section: str, values: Mapping[str, str | float]) -> bool:
    """Whether `new` parses to `old` with these values in the section."""
    expected: dict[str, Any] = tomllib.loads(old)
    table = expected.setdefault(section, {})
    if not isinstance(table, dict):
        return False
    table.update({key: tomllib.loads(f"v = {_written(values[key])}")["v"] for key in values})
    try:
        return tomllib.loads(new) == expected
    except tomllib.TOMLDecodeError:
        return False
