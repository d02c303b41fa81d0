"""The folder of a station belongs to one user, who alone may change it, and has no links."""

import os
from collections.abc import Iterator
from pathlib import Path

from classify.base.errors import InputError

try:
    import pwd
except ImportError:  # Windows
    pwd = None  # type: ignore[assignment]

SESSIONS = "sessions.json"
SECRETS = ("users.json", "tokens.json", SESSIONS)
# All permissions of others, and the group's permission to write.
_TOO_OPEN = 0o027


def make_files_private() -> None:
    """Make new files of this process readable by its user and group alone."""
    os.umask(os.umask(_TOO_OPEN) | _TOO_OPEN)


def require_own_folder(folder: Path) -> None:
    """Check that a station's folder belongs to this user, and that no link lies in it."""
    if not folder.is_dir():
        return  # reading its configuration raises an error
    owner = folder.stat().st_uid
    if pwd is not None and owner != os.geteuid():
        raise InputError(
            f"{folder}: belongs to {user_name(owner)}, and this is {user_name(os.geteuid())}; run "
            f"the command as its owner: sudo -u {user_name(owner)} ps4rig ..."
        )
    for path in _checked_paths(folder):
        refuse_link(path)


def refuse_link(path: Path) -> None:
    """Raise InputError for a link."""
    if path.is_symlink():
        raise InputError(
            f"{path}: is a link, and no link in the folder of a station is followed; put what it "
            "names in its place, or name that in station.toml"
        )


def too_open(folder: Path) -> list[Path]:
    """Return paths with too many permissions; files with secrets are for the owner alone."""
    return [
        path
        for path in (folder, *_checked_paths(folder))
        if path.stat().st_mode & (0o077 if path.name in SECRETS else _TOO_OPEN)
    ]


def _checked_paths(folder: Path) -> Iterator[Path]:
    """Yield the entries of the folder, and the recipes."""
    yield from sorted(folder.iterdir())
    yield from sorted((folder / "recipes").glob("*"))


def user_name(number: int) -> str:
    """Return the name of a user of the system, or ``user N`` if the system lists none."""
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"
