"""A real systemd as process 1 of namespaces of its own, on a copy of this machine's files.

`python -m tests.capture.station.service.systemd_container` says whether one boots on this machine.
"""

import os
import shlex
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

_BOOT = Path(__file__).with_name("boot_systemd.sh")
_ROOT = Path(__file__).parents[4]
# Where a machine with both versions of control groups has the second one.
_CGROUPS = (Path("/sys/fs/cgroup/unified"), Path("/sys/fs/cgroup"))
_NAMESPACES = ("--mount", "--pid", "--ipc", "--uts", "--cgroup")
_TIMEOUT_S = 300.0


class SystemdContainer:
    """Runs commands as root beside a systemd; `systemd_container` boots one.

    Attributes
    ----------
    shared
        A folder of this machine, which is ``/mnt`` there.
    """

    def __init__(self, process: int, shared: Path) -> None:
        self._process = process
        self.shared = shared

    def run(self, *command: object, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Run a command; its environment is that of a service."""
        enter = ("nsenter", "--target", str(self._process), *_NAMESPACES, "--", "env", "-i")
        path = "PATH=/usr/local/bin:/usr/bin:/usr/sbin:/bin:/sbin"
        done = subprocess.run(
            [*enter, path, *map(str, command)],
            stdin=subprocess.DEVNULL, capture_output=True, text=True,
            timeout=_TIMEOUT_S, check=False,
        )  # fmt: skip
        assert not check or done.returncode == 0, f"{shlex.join(map(str, command))}: {done}"
        return done

    def shown(self, unit: str, name: str) -> str:
        """A property of a unit."""
        return self.run("systemctl", "show", unit, f"--property={name}", "--value").stdout.strip()

    def until(self, is_there: Callable[[], bool]) -> None:
        """Wait until something holds."""
        ends_s = time.monotonic() + _TIMEOUT_S
        while not is_there():
            assert time.monotonic() < ends_s, self.run("journalctl", "-n", "40").stdout
            time.sleep(0.2)


@contextmanager
def systemd_container(shared: Path) -> Iterator[SystemdContainer]:
    """Boot systemd, and kill all its processes at the end."""
    assert os.geteuid() == 0, "a systemd takes root: run the suite as root"
    group = next(path for path in _CGROUPS if (path / "cgroup.controllers").exists())
    group /= f"ps4rig-{shared.name}-{os.getpid()}"
    paths = {Path(place).resolve() for place in sys.path if Path(place).is_dir()}
    paths |= {_ROOT, Path(sys.prefix), Path(sys.base_prefix), Path(sysconfig.get_path("stdlib"))}
    command = ["unshare", *_NAMESPACES, "--fork", "--kill-child", "--propagation", "private"]
    command += ["/bin/sh", str(_BOOT), str(shared), *map(str, sorted(paths))]
    group.mkdir()
    try:
        # In its group before it makes the namespace, whose root the group becomes.
        join = f"echo $$ > {shlex.quote(str(group / 'cgroup.procs'))} && exec {shlex.join(command)}"
        with subprocess.Popen(
            ["/bin/sh", "-c", join],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        ) as parent:  # fmt: skip
            try:
                yield _booted(parent, shared)
            finally:
                parent.kill()
    finally:
        _remove_group(group)


def _booted(parent: subprocess.Popen[bytes], shared: Path) -> SystemdContainer:
    ends_s = time.monotonic() + _TIMEOUT_S
    children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children")
    while True:
        assert parent.poll() is None, parent.communicate()[0].decode(errors="replace")
        assert time.monotonic() < ends_s, "systemd does not boot"
        if found := children.read_text().split():
            container = SystemdContainer(int(found[0]), shared)
            asked = container.run("systemctl", "is-active", "test.target", check=False)
            if asked.stdout == "active\n":
                return container
        time.sleep(0.1)


def _remove_group(group: Path) -> None:
    """Remove the control groups, once their last processes are gone."""
    for _ in range(100):
        for path in sorted(group.rglob("*"), reverse=True):
            if path.is_dir():
                _removed(path)
        if _removed(group):
            return
        time.sleep(0.1)


def _removed(path: Path) -> bool:
    try:
        path.rmdir()
    except OSError:
        return False
    return True


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, systemd_container(Path(folder)):
        print("a systemd boots on this machine")
