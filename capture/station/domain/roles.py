"""The three roles, and who asks."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from capture.base.names import file_name
from classify.base.errors import InputError


class Role(StrEnum):
    """A role; each one includes the permissions of the previous one."""

    OPERATOR = "operator"  # sees everything, triggers, acknowledges
    ENGINEER = "engineer"  # overrides verdicts, teaches, approves, changes settings
    ADMINISTRATOR = "administrator"  # users and tokens

    def includes(self, other: "Role") -> bool:
        """Whether this role may do what `other` may."""
        order = tuple(Role)
        return order.index(self) >= order.index(other)


@dataclass(frozen=True)
class Identity:
    """A person or a program that asks for something."""

    name: str
    role: Role
    # ``this machine`` while the station has no users.
    via: Literal["page", "kiosk", "API", "command", "this machine"]
    csrf: str = ""  # token that a change from this session must carry; empty for others


def require_name(kind: str, name: str) -> None:
    """Check the name of a user or client."""
    try:
        file_name(name)
    except ValueError as error:
        raise InputError(
            f"{kind} name {name[:100]!r}: up to 100 letters, digits and _ . -, the first a letter "
            "or digit"
        ) from error
