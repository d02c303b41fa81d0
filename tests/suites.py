"""The suites of tests that need more than Python, and where `install.sh` puts what they need."""

import os
import shutil
import sysconfig
from pathlib import Path

_CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ps4rig"
KERNEL = Path(os.environ.get("PS4RIG_HIL_KERNEL") or _CACHE / "hil-kernel")
# Debian keeps them out of the search path of users.
MOSQUITTO = Path("/usr/sbin/mosquitto")
NGINX = Path("/usr/sbin/nginx")
# The extra genicam, in this environment.
GENICAM = Path(sysconfig.get_path("platlib")) / "gi"
_POSTGRESQL = Path("/usr/lib/postgresql")
MICROPYTHON = Path(os.environ.get("PS4RIG_MICROPYTHON") or _CACHE / "micropython")
# The jar of Debian's package, and that of Bio-Formats, which is in Fiji.
IMAGEJ = Path("/usr/share/java/ij.jar")
BIOFORMATS = Path(os.environ.get("PS4RIG_BIOFORMATS") or _CACHE / "bioformats")


def postgresql_program(name: str) -> Path:
    """A program of the newest PostgreSQL; Debian keeps them out of the search path."""
    versions = _POSTGRESQL.glob(f"*/bin/{name}")
    return max(versions, key=lambda path: int(path.parts[4]), default=_POSTGRESQL / name)


# Programs and folders, by the marker of the suite.
NEEDS: dict[str, tuple[str | Path, ...]] = {
    "browser": ("chromium", "curl", NGINX),
    "genicam": (GENICAM,),
    "imagej": ("java", IMAGEJ, BIOFORMATS),
    "kernel": ("qemu-system-x86_64", "busybox", KERNEL),
    "micropython": ("node", MICROPYTHON),
    "mqtt": (MOSQUITTO,),
    "postgresql": (postgresql_program("initdb"), postgresql_program("psql")),
    "systemd": ("systemd-analyze", "nsenter", Path("/lib/systemd/systemd")),
}


def missing(suite: str) -> list[str]:
    """The needs of a suite that this machine does not meet."""
    return [
        str(need)
        for need in NEEDS[suite]
        if not (need.exists() if isinstance(need, Path) else shutil.which(need))
    ]
