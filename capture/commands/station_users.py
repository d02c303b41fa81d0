"""``ps4rig station user`` and ``ps4rig station token``: who may use a station's panel and API."""

from __future__ import annotations

import sys
from typing import Annotated, Literal

import typer

from capture.base.console import new_table, out, print_table
from capture.base.utc_time import readable_utc
from capture.commands import options

_UserName = Annotated[str, typer.Argument(metavar="NAME", help="Name of the user.")]
_ClientName = Annotated[str, typer.Argument(metavar="NAME", help="Name of the API client.")]
_RoleName = Annotated[
    Literal["operator", "engineer", "administrator"],
    typer.Option(
        help="An operator sees everything and triggers, an engineer also teaches and overrides, an "
        "administrator also changes users."
    ),
]


def add_user(folder: options.Station, name: _UserName, role: _RoleName) -> None:
    """Add a user, or change the role and password of one.

    The password is asked for, or is the first line of the standard input.
    """
    from capture.station.domain.folder import StationFolder
    from capture.station.domain.users import Role
    from capture.station.results.accounts import accounts_on_the_terminal

    with accounts_on_the_terminal(StationFolder(folder)) as accounts:
        accounts.put_user(name, Role(role), _password(name))
    out.print(f"user {name}: {role}")


def set_kiosk(folder: options.Station) -> None:
    """Set the PIN by which the line's screens log in as an operator.

    Their addresses are kiosk_addresses of station.toml. The PIN is asked for, or is the first line
    of the standard input. To end it, remove the user kiosk.
    """
    from capture.station.domain.folder import StationFolder
    from capture.station.domain.users import KIOSK
    from capture.station.results.accounts import accounts_on_the_terminal

    station = StationFolder(folder)
    with accounts_on_the_terminal(station) as accounts:
        accounts.put_kiosk(_password(KIOSK))
    screens = ", ".join(map(str, station.config.panel.kiosk_addresses))
    out.print(f"user {KIOSK}: operator, at {screens or 'no screen; set kiosk_addresses'}")


def remove_user(folder: options.Station, name: _UserName) -> None:
    """Remove a user; the sessions of this user end at once."""
    from capture.station.domain.folder import StationFolder
    from capture.station.results.accounts import accounts_on_the_terminal

    with accounts_on_the_terminal(StationFolder(folder)) as accounts:
        accounts.remove_user(name)
    out.print(f"user {name}: removed")


def list_users(folder: options.Station) -> None:
    """List the users."""
    from capture.station.domain.folder import StationFolder
    from capture.station.domain.users import Users

    table = new_table("user", "role")
    for user in Users(StationFolder(folder).path).all():
        table.add_row(user.name, user.role)
    print_table(table)


def add_token(folder: options.Station, name: _ClientName, role: _RoleName) -> None:
    """Add an API client and print its token, which is not stored."""
    from capture.station.domain.folder import StationFolder
    from capture.station.domain.users import Role
    from capture.station.results.accounts import accounts_on_the_terminal

    with accounts_on_the_terminal(StationFolder(folder)) as accounts:
        out.print(accounts.add_client(name, Role(role)))


def remove_token(folder: options.Station, name: _ClientName) -> None:
    """Remove an API client; its token is invalid at once."""
    from capture.station.domain.folder import StationFolder
    from capture.station.results.accounts import accounts_on_the_terminal

    with accounts_on_the_terminal(StationFolder(folder)) as accounts:
        accounts.remove_client(name)
    out.print(f"client {name}: removed")


def list_tokens(folder: options.Station) -> None:
    """List the API clients."""
    from capture.station.domain.folder import StationFolder
    from capture.station.domain.users import Tokens

    table = new_table("client", "role", "since")
    for client in Tokens(StationFolder(folder).path).all():
        table.add_row(client.name, client.role, readable_utc(client.created_utc))
    print_table(table)


def _password(name: str) -> str:
    if sys.stdin.isatty():
        return str(typer.prompt(f"password of {name}", hide_input=True, confirmation_prompt=True))
    return sys.stdin.readline().rstrip("\r\n")
