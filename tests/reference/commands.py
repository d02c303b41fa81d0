"""The page of commands: their options as typer knows them."""

import re
from collections import Counter
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin, get_type_hints

import typer

from capture.cli import app

# An option with one text in this many commands is explained once.
_SHARED = 2
_INTRODUCTION = """\
# Commands of ps4rig

In brackets the default; `...` may be repeated. `ps4rig COMMAND --help` says more of each.

## Options of several commands
"""


def commands_page() -> str:
    """Return the page as Markdown."""
    commands = dict(_commands(typer.main.get_command(app), ""))
    options = {name: list(_options(command)) for name, command in commands.items()}
    uses = Counter(option for own in options.values() for option in own)
    shared = [option for option, count in uses.items() if count >= _SHARED]
    lines = [_INTRODUCTION, *map(_line, shared)]
    for name, command in commands.items():
        usage = [_argument(each) for each in command.params if each.param_type_name == "argument"]
        also = " ".join(option[0].split()[0] for option in options[name] if option in shared)
        lines += ["", f"## {' '.join([name, *usage])}", f"{_first_clause(command.help)}."]
        lines[-1] += f" Also `{also}`." if also else ""
        own = [_line(option) for option in options[name] if option not in shared]
        lines += own
    return "\n".join(lines)


def _commands(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    if not hasattr(command, "commands"):
        yield name, command
        return
    for word, each in command.commands.items():
        yield from _commands(each, f"{name} {word}".strip())


def _options(command: Any) -> Iterator[tuple[str, str]]:
    """Yield each option with its value, and its meaning."""
    hints = get_type_hints(command.callback)
    for each in command.params:
        if each.param_type_name == "option":
            hint = hints[each.name]
            value = each.metavar or "|".join(_choices(hint)) or _placeholder(hint)
            names = "/".join([*each.opts, *each.secondary_opts])
            yield f"{names} {value}{' ...' * bool(each.multiple)}".strip(), _meaning(each)


def _argument(argument: Any) -> str:
    name = argument.metavar or argument.name.upper()
    return str(name) if argument.required or name.startswith("[") else f"[{name}]"


def _choices(hint: Any) -> Iterator[str]:
    if get_origin(hint) is Literal:
        yield from map(str, get_args(hint))
    elif isinstance(hint, type) and hasattr(hint, "__members__"):
        yield from map(str, hint)
    else:
        for each in get_args(hint):
            yield from _choices(each)


def _placeholder(hint: Any) -> str:
    if isinstance(hint, type):
        return {bool: "", int: "N", float: "X", str: "TEXT"}.get(hint, "FILE")
    types = [each for each in get_args(hint) if each is not type(None)]
    return " ".join(_placeholder(each) for each in types if each is not ...)


def _meaning(option: Any) -> str:
    shown, default = option.show_default, option.default
    text = shown if isinstance(shown, str) else None
    if option.required:
        text = "required"
    elif text is None and default is not None and default is not False:
        text = str(default)
    return _first_clause(option.help or "") + (f" [{text}]" if text else "")


def _first_clause(text: str) -> str:
    return " ".join(re.split(r"[.:;](?:\s|$)", text)[0].split())


def _line(option: tuple[str, str]) -> str:
    name, meaning = option
    return f"- `{name}` {meaning}"
