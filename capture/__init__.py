"""Captured sets: their acquisition, their files and maps, batches, and the command line.

>>> from capture import CapturedSet, capture_set

    captured = capture_set(rig, label="oak")      # LEDs, frames, checks -> CapturedSet
    captured.save("oak-001.ome.tif")              # one OME-TIFF file
    surface = CapturedSet.load("oak-001.ome.tif").solve()

Photometric and spectral mathematics are in `classify`, device drivers in `rig`.
"""


def __getattr__(name: str) -> object:
    """Import a name of ``__init__.pyi`` when it is first used."""
    # lazy_loader is imported here because it takes longer than all that `capture.__main__` does
    # before it handles signals.
    import lazy_loader

    attach = lazy_loader.attach_stub(__name__, __file__)
    names = dict(zip(("__getattr__", "__dir__", "__all__"), attach, strict=True))
    globals().update(names)
    return names[name] if name in names else names["__getattr__"](name)


def __dir__() -> list[str]:
    return list(__getattr__("__all__"))
