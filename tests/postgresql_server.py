"""A PostgreSQL server of a test's own: a temporary folder, a free port, this machine only."""

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .free_port import free_port
from .suites import postgresql_program

_USER = "postgres" if os.getuid() == 0 else None  # initdb and the server refuse to run as root


class PostgresqlServer:
    """A server that tests start, kill and ask; `postgresql_server` makes one.

    Attributes
    ----------
    url
        The URL of its database ``results``.
    """

    def __init__(self, folder: Path) -> None:
        self._data = folder / "data"
        self._log = folder / "server.log"
        self._port = free_port()
        self.url = self.url_of("results")
        self._run("initdb", "--auth=trust", "--username=ps4rig", "--encoding=UTF8",
                  "--locale=C", "--no-sync", str(self._data))  # fmt: skip

    def url_of(self, database: str) -> str:
        """The URL of a database of this server."""
        return f"postgresql://ps4rig@127.0.0.1:{self._port}/{database}"

    def start(self) -> None:
        """Start the server, and wait until it answers."""
        # A kill leaves to the kernel what was written: only a loss of power needs fsync, and the
        # recovery would call it for each file of each database.
        settings = ("listen_addresses=127.0.0.1", "unix_socket_directories=''", "fsync=off")
        options = " ".join((f"-p {self._port}", *(f"-c {each}" for each in settings)))
        self._run("pg_ctl", "start", "-w", "-t", "60", "-D", str(self._data), "-l",
                  str(self._log), "-o", options)  # fmt: skip

    def kill(self) -> None:
        """Kill all its processes at once, as a loss of power does."""
        lock = self._data / "postmaster.pid"
        main = int(lock.read_text().split("\n")[0])
        children = Path(f"/proc/{main}/task/{main}/children").read_text().split()
        # The main process first: it would start the others anew.
        processes = [main, *map(int, children)]
        for process in processes:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        while any(_is_running(process) for process in processes):
            time.sleep(0.01)
        # In a container without an init, the dead process keeps its number: pg_ctl waits for it.
        lock.unlink()

    def make_database(
        self, name: str, script: Path | None = None, *, encoding: str = "UTF8", more: str = ""
    ) -> str:
        """Make an empty database, or one from a script of pg_dump; return its URL."""
        url = self.url_of(name)
        command = f"""CREATE DATABASE "{name}" TEMPLATE template0 ENCODING '{encoding}' {more}"""
        self._run("psql", "-q", self.url_of("postgres"), "-c", command)
        if script is not None:
            self._run("psql", "-q", "-v", "ON_ERROR_STOP=1", url, stdin=script.read_text())
        return url

    def _run(self, program: str, *arguments: str, stdin: str = "") -> None:
        user = ["runuser", "-u", _USER, "--"] if _USER else []
        # pg_ctl's server keeps a pipe for output open, and the call would wait for its end.
        with (self._log.with_suffix(f".{program}")).open("w") as said:
            done = subprocess.run(
                [*user, str(postgresql_program(program)), *arguments],
                input=stdin, text=True, stdout=said, stderr=said, timeout=120, cwd="/",
            )  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"{program}: {self._log.with_suffix(f'.{program}').read_text()}")


@contextmanager
def postgresql_server() -> Iterator[PostgresqlServer]:
    """Run a server with an empty database ``results``."""
    # Folders of pytest are closed to the server's user.
    with tempfile.TemporaryDirectory(prefix="ps4rig-postgresql-") as folder:
        if _USER:
            shutil.chown(folder, _USER)
        server = PostgresqlServer(Path(folder))
        server.start()
        try:
            server.make_database("results")
            yield server
        finally:
            server.kill()  # nothing of it is kept


def _is_running(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
