"""Hash of the program that judges parts: changed code may have the same version number."""

import hashlib
import platform
from collections.abc import Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGES = ("capture", "classify", "firmware_sim", "rig")
# Packages that compute the measures. `opencv-python-headless` is cv2.
_COMPUTING = ("numpy", "scipy", "numba", "opencv-python-headless", "tifffile")


@cache
def software_sha256() -> str:
    """SHA-256 of this program, computed once a run."""
    return sources_sha256(Path(__file__).parents[3])


def sources_sha256(home: Path) -> str:
    """SHA-256 of the sources in `home`, and of the versions of Python and packages."""
    digest = hashlib.sha256()
    for name, found in (("python", platform.python_version()), *_versions()):
        digest.update(f"{name} {found}\n".encode())
    for package in _PACKAGES:
        for path in sorted((home / package).rglob("*.py")):
            source = path.read_bytes()
            digest.update(f"{path.relative_to(home).as_posix()} {len(source)}\n".encode())
            digest.update(source)
    return digest.hexdigest()


def _versions() -> Iterator[tuple[str, str]]:
    for name in _COMPUTING:
        try:
            yield name, version(name)
        except PackageNotFoundError:  # cv2 of another distribution
            yield name, "unknown"
