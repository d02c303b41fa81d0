"""Memory of this process and of the machine, from ``/proc`` (see proc(5))."""

from pathlib import Path

_PROCESS, _MACHINE = Path("/proc/self/status"), Path("/proc/meminfo")


def resident_bytes() -> int | None:
    """Resident memory of this process; None on systems without ``/proc``."""
    return _bytes(_PROCESS, "VmRSS")


def peak_bytes() -> int | None:
    """Largest resident memory of this process so far; None on systems without ``/proc``."""
    return _bytes(_PROCESS, "VmHWM")


def available_bytes() -> int | None:
    """Memory of the machine that is free without swapping; None on systems without ``/proc``."""
    return _bytes(_MACHINE, "MemAvailable")


def _bytes(path: Path, field: str) -> int | None:
    if not path.exists():
        return None
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        name, value = line.split(":", 1)
        if name == field:
            return 1024 * int(value.split()[0])  # "kB" in /proc is 1024 bytes
    return None
