"""A virtual machine that runs Debian's kernel on the host's files.

The host's file system is the guest's root, read-only, so the guest runs this checkout in this
environment. Results come back in a folder that both share.
"""

import shlex
import shutil
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from tests.suites import KERNEL

from .initramfs import write_initramfs

_TO_BOOT = ("virtio_pci", "9pnet_virtio", "9p")
_MAX_CONSOLE = 6000
# The guest writes a file this often, whatever its checks do, and may be silent for the longer time.
# It boots in 10 s on an idle machine.
_BEAT_S = 5
_SILENCE_S = 180.0
# The emulated processor has lost a register while the guest's kernel released a lock of the shared
# file system. A driver's faults have other messages.
_DOUBLE_FAULT = "PANIC: double fault"


class MachineError(Exception):
    """The guest did not finish."""


class EmulatorError(MachineError):
    """The emulator failed, and not what runs in it: the whole guest stopped."""


def run_in_guest(
    command: Sequence[str],
    *,
    modules: Mapping[str, str],
    shared: Path,
    timeout_s: float,
    devices: Sequence[str] = (),
) -> str:
    """Boot, load `modules`, run `command` with the environment's Python path, power off.

    Parameters
    ----------
    command
        Run as root in the folder of the checkout; `shared` is mounted writable at ``/mnt``.
    modules
        Kernel modules with their options, loaded in this order after their dependencies.
    shared
        An empty folder.
    timeout_s
        After this the guest is killed.
    devices
        QEMU options for more devices.

    Returns
    -------
    str
        The console output.

    Raises
    ------
    MachineError
        If the command did not end in time.
    EmulatorError
        If the guest was silent, or ended by a double fault.
    """
    kernel = max(KERNEL.glob("boot/vmlinuz-*"))
    version = kernel.name.removeprefix("vmlinuz-")
    tree = next(path for path in KERNEL.rglob(f"lib/modules/{version}") if path.is_dir())
    init = shared / "init.sh"
    init.write_text(_init_script(command, modules))
    initramfs = shared / "initramfs.cpio"
    write_initramfs(
        initramfs, Path(str(shutil.which("busybox"))), tree, (*_TO_BOOT, *modules), init.read_text()
    )
    console = shared / "console.txt"
    options = [*_qemu_command(kernel, initramfs, shared), *devices]
    with (
        console.open("wb") as output,
        subprocess.Popen(
            options, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
        ) as machine,
    ):
        try:
            fault = _awaited(machine, shared / "beat", timeout_s)
        finally:
            machine.kill()
    text = console.read_text(encoding="utf-8", errors="replace")
    end = text[-_MAX_CONSOLE:]
    if fault is not None:
        raise type(fault)(f"{fault}:\n{end}")
    if not (shared / "status").exists():
        kind = EmulatorError if _DOUBLE_FAULT in text else MachineError
        raise kind(f"the guest ended before its command:\n{end}")
    return text


def _awaited(machine: subprocess.Popen[bytes], beat: Path, timeout_s: float) -> MachineError | None:
    """Wait for the end of a guest; return why it did not come."""
    began_s = heard_s = time.monotonic()
    last_ns = 0
    while True:
        with suppress(subprocess.TimeoutExpired):
            machine.wait(1.0)
            return None
        now_s, beat_ns = time.monotonic(), beat.stat().st_mtime_ns if beat.exists() else 0
        if beat_ns != last_ns:
            last_ns, heard_s = beat_ns, now_s
        if now_s - heard_s > _SILENCE_S:
            return EmulatorError(f"the guest was silent for {_SILENCE_S:g} s")
        if now_s - began_s > timeout_s:
            return MachineError(f"the guest did not end in {timeout_s:g} s")


def _qemu_command(kernel: Path, initramfs: Path, shared: Path) -> list[str]:
    share = "security_model=none,multidevs=remap"
    return [
        "qemu-system-x86_64",
        # Emulation works everywhere; KVM is missing or incomplete on many CI machines.
        *("-accel", "tcg,thread=single", "-machine", "q35", "-cpu", "Nehalem", "-smp", "1"),
        # The guest's clock counts instructions, 2 ns each: on a busy host the guest is slow, but
        # its times stay consistent.
        *("-icount", "shift=1,sleep=on"),
        *("-m", "1024", "-no-reboot", "-nodefaults", "-display", "none"),
        *("-serial", "stdio", "-kernel", str(kernel), "-initrd", str(initramfs)),
        *("-virtfs", f"local,path=/,mount_tag=host,readonly=on,{share}"),
        *("-virtfs", f"local,path={_for_qemu(shared)},mount_tag=shared,{share}"),
        *("-append", "console=ttyS0 quiet panic=-1 tsc=unstable mitigations=off"),
    ]


def _for_qemu(path: Path) -> str:
    # A comma ends an option; QEMU reads two as one comma.
    return str(path).replace(",", ",,")


def _init_script(command: Sequence[str], modules: Mapping[str, str]) -> str:
    checkout = Path(__file__).parents[2]
    inner = " ".join(
        [
            f"cd {shlex.quote(str(checkout))} &&",
            "PATH=/usr/local/bin:/usr/bin:/bin HOME=/dev/shm TMPDIR=/dev/shm",
            "PYTHONDONTWRITEBYTECODE=1 LANG=C.UTF-8",
            shlex.join(command),
        ]
    )
    options = "\n".join(
        f"        *-{name}.ko) options={shlex.quote(text)} ;;" for name, text in modules.items()
    )
    return f"""#!/bin/busybox sh
b=/bin/busybox
$b mount -t devtmpfs dev /dev
$b mount -t proc proc /proc
$b ifconfig lo 127.0.0.1
for module in $($b ls /modules); do
    options=
    case $module in
{options}
    esac
    $b insmod /modules/$module $options || echo "cannot load $module"
done
nine=trans=virtio,version=9p2000.L,msize=524288
$b mount -t 9p -o ro,cache=loose,$nine host /root || echo "no host files"
$b mount -t 9p -o $nine shared /root/mnt || echo "no shared folder"
$b mount -t devtmpfs dev /root/dev
$b mkdir -p /root/dev/shm /root/dev/pts
$b mount -t tmpfs shm /root/dev/shm
$b mount -t devpts pts /root/dev/pts
$b mount -t proc proc /root/proc
$b mount -t sysfs sys /root/sys
while $b sleep {_BEAT_S}; do echo > /root/mnt/beat; done &
$b chroot /root /bin/sh -c {shlex.quote(inner)}
echo $? > /root/mnt/status
$b sync
$b poweroff -f
"""
