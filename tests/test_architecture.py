"""The house of four rooms: who may import whom, and what is nowhere."""

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ROOMS = ("capture", "rig", "classify", "firmware_sim")
ARROWS = {
    "capture": {"rig", "classify"},
    "rig": {"classify", "firmware_sim"},
    "classify": set(),
    "firmware_sim": set(),
}
NEVER = {
    "firmware_sim": {"numpy", "scipy", "cv2", "numba", "serial"},
    "classify": {"serial", "tifffile", "typer", "rich"},
    "rig": {"typer", "rich"},
    "capture": {"numba", "scipy"},
}
# Within a room: a folder, or a file beside the folders, imports only what stands on a storey below.
STOREYS = {
    "classify": (
        {"base"},
        {"confidence", "lighting", "methods", "shadow_rule"},
        {"images"},
        {"lights"},
        {"calibration"},
        {"surface"},
        {"solvers"},
        {"relief", "calibration_benefit"},
        {"texture"},
        {"classifiers"},
        {"library"},
        {"defects", "pieces"},
    ),
    "rig": (
        {"acceptance", "errors", "image_metadata", "raw_image", "set_file", "signals"},
        {"image_file"},
        {"scene"},
        {"cameras"},
        {"config"},
        {"lights"},
        {"initial_config", "simulation"},
        {"rig"},
        {"fresh_frame"},
        {"step_fit"},
        {"latency"},
        {"doctor"},
    ),
    "capture": (
        {"base"},
        {"calibration"},
        {"sets"},
        {"procedures"},
        {"acquisition", "maps"},
        {"batch"},
        {"session"},
        {"station"},
        {"chapter"},
        {"commands"},
        {"cli"},
        {"__main__"},
    ),
    "capture/station": (
        {"domain"},
        {"results"},
        {"judge"},
        {"run"},
        {"line"},
        {"panel"},
        {"service"},
    ),
}
# Modules that only POSIX has. A function that needs one imports it itself, or the import at the top
# of the file may fail.
POSIX_MODULES = {"fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty"}
FOR_POSIX_ONLY = {"firmware_sim/terminals.py"}
# What the program says about itself is no part of its work.
ONLY_FOR_COMMANDS = {"chapter"}
UNSAFE_MODULES = {"pickle", "cPickle", "dill", "joblib", "marshal", "shelve"}
UNSAFE_CALLS = {"eval", "exec", "__import__", "import_module", "system", "popen"}
UNSAFE_FLAGS = {"shell", "allow_pickle"}
LONGEST_FILE = 400
LONGER_FILES = {"firmware_sim/firmware.py": 500}  # one file, because it is copied to a board whole

FILES = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
# All but the public faces, which show what is on every storey.
STOREY_FILES = [
    (room, path)
    for room in STOREYS
    for path in sorted((ROOT / room).rglob("*.py"))
    if path != ROOT / room / "__init__.py"
]


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def parsed(source: str) -> ast.Module:
    return ast.parse(source)


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def imports(source: str, package: tuple[str, ...]) -> Iterator[str]:
    """Full names of all modules imported anywhere in a source file of `package`."""
    yield from imported(ast.walk(parsed(source)), package)


def imported(nodes: Iterable[ast.AST], package: tuple[str, ...]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            # One dot is the package itself, each further one its parent; from beyond the top, "".
            above = package[: len(package) - node.level + 1] if node.level else ()
            if node.module is None and above:
                yield from (".".join([*above, alias.name]) for alias in node.names)
            else:
                yield ".".join([*above, *(node.module or "").split(".")])


def run_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes but those that only a type checker sees."""
    yield node
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield from run_nodes(child)


def faults(source: str) -> Iterator[str]:
    """Calls and keywords that have no place in a program that reads other people's files."""
    for node in ast.walk(parsed(source)):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        name = called.id if isinstance(called, ast.Name) else getattr(called, "attr", "")
        if name in UNSAFE_CALLS:
            yield f"{name}() in line {node.lineno}"
        for keyword in node.keywords:
            off = isinstance(keyword.value, ast.Constant) and keyword.value.value is False
            if keyword.arg in UNSAFE_FLAGS and not off:
                yield f"{keyword.arg} in line {node.lineno}"


def imports_of(path: Path) -> Iterator[str]:
    return imports(text_of(path), path.relative_to(ROOT).parent.parts)


def imported_tops(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imports_of(path)}


def assert_none(violations: Iterable[str]) -> None:
    assert "\n".join(violations) == ""


def test_a_file_imports_only_along_the_arrows() -> None:
    def violations(path: Path) -> set[str]:
        room = path.relative_to(ROOT).parts[0]
        tops = imported_tops(path)
        upwards = tops & set(ROOMS) - ARROWS[room] - {room}
        return upwards | tops & (NEVER[room] | UNSAFE_MODULES | {"", "tests"})

    assert_none(f"{name_of(path)} imports {name}" for path in FILES for name in violations(path))


def test_a_file_needs_nothing_that_only_posix_has() -> None:
    def violations(path: Path) -> set[str]:
        return set(imported(parsed(text_of(path)).body, ())) & POSIX_MODULES

    found = {name_of(path): violations(path) for path in FILES}
    assert {name for name, modules in found.items() if modules} == FOR_POSIX_ONLY


def test_a_file_imports_only_from_its_folder_and_from_storeys_below() -> None:
    def violations(room: str, path: Path) -> set[str]:
        place = path.relative_to(ROOT / room).with_suffix("").parts[0]
        storey = next(number for number, places in enumerate(STOREYS[room]) if place in places)
        below = set().union(*STOREYS[room][:storey])
        allowed = {place} | below if place == "commands" else {place} | below - ONLY_FOR_COMMANDS
        prefix = room.replace("/", ".") + "."
        names = (f"{name}." for name in imports_of(path))
        inside = (name.removeprefix(prefix) for name in names if name.startswith(prefix))
        return {name.split(".")[0] for name in inside} - allowed

    assert_none(
        f"{name_of(path)} imports {name or 'its own room'}"
        for room, path in STOREY_FILES
        for name in violations(room, path)
    )


@cache
def module_edges() -> dict[str, set[str]]:
    """All modules of the house with the names that each imports when it is loaded."""

    def edges(path: Path) -> Iterator[str]:
        package = path.relative_to(ROOT).parent.parts
        for node in run_nodes(parsed(text_of(path))):
            modules = list(imported([node], package))
            yield from modules
            # `from module import name` may import the module `module.name`.
            names = node.names if isinstance(node, ast.ImportFrom) and node.module else []
            yield from (f"{module}.{alias.name}" for module in modules for alias in names)

    files = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in FILES
    }
    return {module: set(edges(path)) for module, path in files.items()}


def test_no_files_import_each_other_in_a_circle() -> None:
    edges = module_edges()
    assert edges.keys() <= set(TopologicalSorter(edges).static_order())


def test_no_folders_import_each_other_in_a_circle() -> None:
    # The files and folders in one folder, by the imports of everything in them.
    inside: dict[str, dict[str, set[str]]] = {}
    edges = module_edges()
    for module, imported_names in edges.items():
        for name in imported_names & edges.keys():
            one, other = module.split("."), name.split(".")
            shared = next(
                (n for n, pair in enumerate(zip(one, other, strict=False)) if pair[0] != pair[1]),
                min(len(one), len(other)),
            )
            if shared < min(len(one), len(other)):
                places = inside.setdefault(".".join(one[:shared]), {})
                places.setdefault(one[shared], set()).add(other[shared])
    for places in inside.values():
        assert set(TopologicalSorter(places).static_order())


def test_a_file_runs_no_text_as_code() -> None:
    assert_none(f"{name_of(path)}: {fault}" for path in FILES for fault in faults(text_of(path)))


def test_a_file_can_be_read_in_one_sitting() -> None:
    lines = {name_of(path): len(text_of(path).splitlines()) for path in FILES}
    assert_none(
        f"{name} has {count} lines"
        for name, count in lines.items()
        if count > LONGER_FILES.get(name, LONGEST_FILE)
    )


def private_patches(source: str) -> Iterator[str]:
    """Names with an underscore that a test replaces by ``setattr``."""
    for node in ast.walk(parsed(source)):
        if isinstance(node, ast.Call) and getattr(node.func, "attr", "") in {"setattr", "delattr"}:
            names = [str(word.value) for word in node.args[:2] if isinstance(word, ast.Constant)]
            yield from (name for name in names if name.split(".")[-1].startswith("_"))


def test_no_test_patches_a_private_name() -> None:
    files = sorted((ROOT / "tests").rglob("*.py"))
    patching = [path for path in files if re.search("(set|del)attr", text_of(path))]
    assert patching
    assert_none(
        f"{name_of(path)} patches {name}"
        for path in patching
        for name in private_patches(text_of(path))
    )


def test_every_room_is_there_and_every_arrow_is_used() -> None:
    for room in ROOMS:
        files = [path for path in FILES if path.relative_to(ROOT).parts[0] == room]
        assert files
        used = set().union(*map(imported_tops, files)) & set(ROOMS) - {room}
        assert used == ARROWS[room]


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("import rig.camera as c, numpy", {"rig.camera", "numpy"}),
        ("from rig import camera", {"rig"}),
        ("def f():\n    if True:\n        from capture.cli import main", {"capture.cli"}),
        ("try:\n    import serial\nexcept ImportError:\n    pass", {"serial"}),
        ("from . import errors, match", {"classify.inner.errors", "classify.inner.match"}),
        ("from .. import errors", {"classify.errors"}),
        ("from ..errors import InputError", {"classify.errors"}),
        ("from ...rig import camera", {"rig"}),
    ],
)
def test_the_walk_sees_every_kind_of_import(source: str, expected: set[str]) -> None:
    assert set(imports(source, ("classify", "inner"))) == expected


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("eval('1')", 1),
        ("import os\nos.system('ls')", 1),
        ("subprocess.run('ls', shell=True)", 1),
        ("subprocess.run(['ls'], shell=False)", 0),
        ("np.load(f, allow_pickle=maybe)", 1),
        ("np.load(f, allow_pickle=False)", 0),
        ("literal_eval('1')", 0),
    ],
)
def test_the_walk_sees_what_is_unsafe(source: str, count: int) -> None:
    assert len(list(faults(source))) == count


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("monkeypatch.setattr(module, '_X', 1)", ["_X"]),
        ("patch.setattr('rig.module._X', 1)", ["rig.module._X"]),
        ("patch.setattr(module, 'x_y', _z)", []),
    ],
)
def test_the_walk_sees_private_patches(source: str, names: list[str]) -> None:
    assert list(private_patches(source)) == names
