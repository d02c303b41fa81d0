"""Replace a folder of result files so that no reader takes half of them for a result."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from .durable_file import make_folder, sync, temporary_path
from .errors import InputError


@contextmanager
def durable_folder(folder: Path, names: Collection[str], first: str) -> Iterator[Path]:
    """Yield a temporary folder whose files move to `folder` when the block ends well.

    Of a folder that exists, the old files called `names` are removed, `first` first, and the new
    ones are moved in, `first` last: a folder with the file `first` is complete.
    """
    folder = folder.resolve()
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: cannot be made: File exists")
    make_folder(folder.parent)
    is_new = not folder.exists()
    # Inside a folder that exists, which may be a mount point.
    with temporary_path(folder.parent if is_new else folder, folder, is_folder=True) as temporary:
        yield temporary
        for path in (*temporary.iterdir(), temporary):
            sync(path)
        if is_new:
            temporary.rename(folder)
            sync(folder.parent)
            return
        order = sorted(names, key=lambda name: name != first)
        for name in order:
            (folder / name).unlink(missing_ok=True)
        for name in reversed(order):
            if (temporary / name).exists():
                (temporary / name).rename(folder / name)
        sync(folder)
