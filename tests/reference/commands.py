"""The page of commands: their options as typer knows them."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import typer

from capture.cli import app
from classify.methods import METHODS

# An option with one meaning in this many commands is explained once.
_SHARED = 2
_METHODS = ", ".join(METHODS)
# Options whose name, value and default say what they mean.
_PLAIN = frozenset(
    {
        "--classes N",
        "--crop X,Y,W,H",
        "--diameter-mm X",
        "--host TEXT",
        "--led N",
        "--level PERCENT",
        "--lights N",
        "--operator TEXT",
        "--out DIR",
        "--out PAGE.html",
        "--reason TEXT",
        "--recipe NAME",
        "--recipe TEXT",
        "--seed N",
        "--square-mm X",
        "--workers N",
    }
)
_INTRODUCTION = f"""\
# Commands of ps4rig

In brackets the default; `...` may be repeated; METHOD is one of {_METHODS}.
`ps4rig COMMAND --help` says more of each.

## Options of several commands
"""


class Option(NamedTuple):
    """An option of a command."""

    name: str  # with its value
    meaning: str
    default: str  # empty if there is none to state

    @property
    def key(self) -> tuple[str, str]:
        """Name and meaning, which commands with different defaults share."""
        return self.name, self.meaning


def commands_page() -> str:
    """Return the page as Markdown."""
    commands = dict(_commands(typer.main.get_command(app), ""))
    options = {name: list(_options(command)) for name, command in commands.items()}
    shared = _shared(options)
    lines = [_INTRODUCTION, *map(_line, _distinguished(shared, options))]
    for name, command in commands.items():
        usage = [_argument(each) for each in command.params if each.param_type_name == "argument"]
        also = _also([each for each in options[name] if each.key in shared], shared)
        lines += ["", f"## {' '.join([name, *usage])}", f"{_first_clause(command.help)}.{also}"]
        lines += [_line(each) for each in options[name] if each.key not in shared]
    return "\n".join(lines)


def _shared(options: Mapping[str, list[Option]]) -> dict[tuple[str, str], str]:
    """Return the most common default of each option that several commands have."""
    defaults: dict[tuple[str, str], Counter[str]] = {}
    for option in (each for own in options.values() for each in own):
        defaults.setdefault(option.key, Counter())[option.default] += 1
    return {
        key: counts.most_common(1)[0][0]
        for key, counts in defaults.items()
        if counts.total() >= _SHARED
    }


def _distinguished(
    shared: Mapping[tuple[str, str], str], options: Mapping[str, list[Option]]
) -> Iterator[Option]:
    """Yield the shared options; one of several meanings or values names its commands."""
    uses = Counter(name.split()[0] for name, _ in shared)
    for key, default in shared.items():
        name, meaning = key
        if uses[name.split()[0]] > 1:
            users = [
                command for command, own in options.items() if key in {option.key for option in own}
            ]
            groups = dict.fromkeys(command.split()[0] for command in users)
            meaning = f"of {', '.join(groups)}" + (f": {meaning}" if meaning else "")
        yield Option(name, meaning, default)


def _also(options: list[Option], usual_defaults: Mapping[tuple[str, str], str]) -> str:
    """Return the sentence that names the shared options of a command."""
    usual = [each for each in options if each.default == usual_defaults[each.key]]
    names = f"`{' '.join(_bare_name(each) for each in usual)}`" if usual else ""
    others = [
        f"`{_bare_name(each)}`{_in_brackets(each.default or 'none')}"
        for each in options
        if each not in usual
    ]
    return f" Also {', '.join(filter(None, [names, *others]))}." if options else ""


def _bare_name(option: Option) -> str:
    return option.name.split()[0]


def _commands(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    if not hasattr(command, "commands"):
        yield name, command
        return
    for word, each in command.commands.items():
        yield from _commands(each, f"{name} {word}".strip())


def _options(command: Any) -> Iterator[Option]:
    hints = get_type_hints(command.callback)
    for each in command.params:
        if each.param_type_name == "option":
            hint = hints[each.name]
            value = each.metavar or "|".join(_choices(hint)) or _placeholder(hint)
            names = "/".join([*each.opts, *each.secondary_opts])
            name = f"{names} {value}{' ...' * bool(each.multiple)}".strip()
            yield Option(name, "" if name in _PLAIN else _meaning(each), _default(each))


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
    meaning = _first_clause(option.help or "")
    return re.sub(f"(, |^)one of {_METHODS}$", "", meaning, flags=re.IGNORECASE)


def _default(option: Any) -> str:
    if option.required:
        return "required"
    if isinstance(option.show_default, str):
        return option.show_default
    return "" if option.default is None or option.default is False else str(option.default)


def _first_clause(text: str) -> str:
    return " ".join(re.split(r"[.:;](?:\s|$)", text)[0].split())


def _line(option: Option) -> str:
    meaning = f" {option.meaning}" if option.meaning else ""
    return f"- `{option.name}`{meaning}{_in_brackets(option.default)}"


def _in_brackets(default: str) -> str:
    return f" [{default}]" if default else ""
