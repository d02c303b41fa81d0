"""An initramfs of busybox, kernel modules in loading order, and an init script."""

import lzma
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

_FOLDERS = ("bin", "dev", "modules", "proc", "root")


def write_initramfs(
    target: Path, busybox: Path, module_tree: Path, modules: Iterable[str], init: str
) -> None:
    """Write an uncompressed initramfs; the names /modules/NN-name.ko sort into loading order.

    Modules built into the kernel are skipped.
    """
    entries = [(name, b"", 0o040755) for name in _FOLDERS]
    entries.append(("bin/busybox", busybox.read_bytes(), 0o100755))
    entries.append(("init", init.encode(), 0o100755))
    for number, (name, image) in enumerate(_with_dependencies(module_tree, modules).items()):
        entries.append((f"modules/{number:02d}-{name}.ko", image, 0o100644))
    with target.open("wb") as out:
        for inode, (name, content, mode) in enumerate([*entries, ("TRAILER!!!", b"", 0)], 1):
            out.write(_cpio_entry(inode, name, content, mode))


def _with_dependencies(tree: Path, names: Iterable[str]) -> dict[str, bytes]:
    """The images of modules by name, each after its dependencies."""
    files = {_plain(path.name): path for path in tree.rglob("*.ko*")}
    ordered: dict[str, bytes] = {}

    def add(name: str) -> None:
        if name in ordered or name not in files:
            return
        image = _unpacked(files[name])
        for dependency in _dependencies(image):
            add(dependency)
        ordered[name] = image

    for name in names:
        add(name)
    return ordered


def _plain(name: str) -> str:
    return name.split(".ko")[0].replace("-", "_")


def _unpacked(path: Path) -> bytes:
    image = path.read_bytes()
    return lzma.decompress(image) if path.suffix == ".xz" else image


def _dependencies(image: bytes) -> Iterator[str]:
    # There is no modules.dep: depmod runs when a kernel is installed, and this one is unpacked.
    depends = re.search(rb"\0depends=([^\0]*)\0", image)
    for name in (depends[1].decode() if depends else "").split(","):
        if name:
            yield name.replace("-", "_")


def _cpio_entry(inode: int, name: str, content: bytes, mode: int) -> bytes:
    """One entry in the "newc" format that the kernel unpacks."""
    path = name.encode() + b"\0"
    fields = (inode, mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(path), 0)
    head = b"070701" + b"".join(b"%08X" % field for field in fields) + path
    return _to_four(head) + _to_four(content)


def _to_four(block: bytes) -> bytes:
    return block + b"\0" * (-len(block) % 4)
