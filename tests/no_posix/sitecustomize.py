"""Make a Python process on Linux behave as on Windows, as far as ps4rig can tell.

The folder of this file comes first in ``PYTHONPATH``, so that worker processes have it too.
"""

import errno
import os
import select
import shutil
import signal
import socket
import stat
import sys
import tempfile
from pathlib import Path

for name in ("fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty"):
    sys.modules[name] = None  # its import fails

# https://docs.python.org/3/library/signal.html, os.html and select.html. Left are names that numpy
# and Python's own modules for starting processes need on this system.
SIGNALS = {"SIGABRT", "SIGFPE", "SIGILL", "SIGINT", "SIGSEGV", "SIGTERM", "SIG_DFL", "SIG_IGN"}
SIGNAL_FUNCTIONS = {
    "default_int_handler", "getsignal", "raise_signal", "set_wakeup_fd", "signal", "strsignal",
    "valid_signals",
}  # fmt: skip
POSIX_ONLY = """
    O_CLOEXEC O_DIRECTORY O_DSYNC O_NOATIME O_NOCTTY O_NOFOLLOW O_NONBLOCK O_SYNC chown chroot
    fchdir fchmod fchown fdatasync fork forkpty getegid geteuid getgid getgroups getloadavg getpgid
    getpgrp getpriority getresuid getsid getuid killpg lchown lockf mkfifo mknod nice openpty
    pathconf pipe2 posix_fadvise posix_fallocate pread preadv pwrite pwritev readv register_at_fork
    SCHED_IDLE sched_getaffinity sched_param sched_setaffinity sched_setscheduler sched_yield
    setegid seteuid setgid setpriority setsid setuid sync tcgetpgrp tcsetpgrp ttyname wait wait3
    wait4 writev
"""
for name in dir(signal):
    is_function = name.islower() and name[0] != "_" and callable(getattr(signal, name))
    if name not in (SIGNAL_FUNCTIONS if is_function else SIGNALS) and (
        is_function or name.startswith("SIG")
    ):
        delattr(signal, name)
for name in POSIX_ONLY.split():
    if hasattr(os, name):
        delattr(os, name)
for name in ("epoll", "poll"):
    delattr(select, name)
delattr(socket, "AF_UNIX")
# On Linux the first is removed while it is open, and the second opens folders.
tempfile.TemporaryFile = tempfile.NamedTemporaryFile
shutil._use_fd_functions = False

really_open, really_fsync, really_select = os.open, os.fsync, select.select
opened_for_reading = set()


def open_file(path, flags, *arguments, **options):
    """Open no folder."""
    if Path(os.fsdecode(path)).is_dir():
        raise PermissionError(errno.EACCES, "Permission denied", path)
    descriptor = really_open(path, flags, *arguments, **options)
    if flags & (os.O_RDWR | os.O_WRONLY):
        opened_for_reading.discard(descriptor)
    else:
        opened_for_reading.add(descriptor)
    return descriptor


def fsync(descriptor):
    """Sync only what is open for writing."""
    if descriptor in opened_for_reading:
        raise OSError(errno.EBADF, "Bad file descriptor")
    really_fsync(descriptor)


def is_socket(descriptor):
    return stat.S_ISSOCK(os.fstat(descriptor).st_mode)


def of_no_socket(really):
    """Refuse sockets, whose numbers are no descriptors of files."""

    def call(descriptor, *arguments):
        if is_socket(descriptor):
            raise OSError(errno.EBADF, "Bad file descriptor")
        return really(descriptor, *arguments)

    return call


def select_sockets(*arguments):
    """Wait for one socket or more, and for nothing else."""
    waited = [each for one in arguments[:3] for each in one]
    if not waited:
        raise OSError(errno.EINVAL, "An invalid argument was supplied")
    if not all(is_socket(each if isinstance(each, int) else each.fileno()) for each in waited):
        raise OSError(errno.ENOTSOCK, "An operation was attempted on something that is no socket")
    return really_select(*arguments)


def refused_while_open(really):
    """Rename and remove no file that this process has open."""

    def call(*paths, **options):
        held = {os.path.realpath(each) for each in Path("/proc/self/fd").iterdir()}
        for path in paths[:2]:
            if os.path.realpath(os.fsdecode(path)) in held:
                raise PermissionError(errno.EACCES, "It is being used by another process", path)
        return really(*paths, **options)

    return call


os.open, os.fsync = open_file, fsync
os.read, os.write = of_no_socket(os.read), of_no_socket(os.write)
select.select = select_sockets
for name in ("remove", "rename", "replace", "rmdir", "unlink"):
    setattr(os, name, refused_while_open(getattr(os, name)))
