"""A virtual machine that runs Debian's kernel on the host's files.

The host's file system is the guest's root, read-only, so the guest runs this checkout in this
environment. Results come back in a folder that both share.
"""

import shlex
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.suites import KERNEL

from .initramfs import write_initramfs

_TO_BOOT = ("virtio_pci", "9pnet_virtio", "9p")
_MAX_CONSOLE = 6000


class MachineError(Exception):
    """The guest did not finish."""


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
    try:
        done = subprocess.run(
            [*_qemu_command(kernel, initramfs, shared), *devices],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        console = (error.stdout or b"").decode(errors="replace")
        raise MachineError(
            f"the guest did not end in {timeout_s:g} s:\n{console[-_MAX_CONSOLE:]}"
        ) from error
    console = done.stdout.decode(errors="replace")
    if not (shared / "status").exists():
        raise MachineError(f"the guest ended before its command:\n{console[-_MAX_CONSOLE:]}")
    return console


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
$b chroot /root /bin/sh -c {shlex.quote(inner)}
echo $? > /root/mnt/status
$b sync
$b poweroff -f
"""
