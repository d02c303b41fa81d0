"""The firmware loads on MicroPython: no imports at run time, no unsupported syntax."""

import ast
from pathlib import Path

import firmware_sim.firmware

SOURCE = Path(firmware_sim.firmware.__file__).read_text(encoding="utf-8")
MICROPYTHON_LACKS = (ast.Match, ast.NamedExpr, ast.AsyncFunctionDef, ast.TryStar)


def test_nothing_is_imported_at_run_time():
    tree = ast.parse(SOURCE)
    guarded = {
        id(node)
        for test in ast.walk(tree)
        if isinstance(test, ast.If) and ast.unparse(test.test) == "TYPE_CHECKING"
        for statement in test.body
        for node in ast.walk(statement)
    }
    imports = [n for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom)]
    assert imports, "the guarded import is found"
    assert all(id(node) in guarded for node in imports)
    assert firmware_sim.firmware.TYPE_CHECKING is False
    assert "__import__" not in SOURCE


def test_no_syntax_that_micropython_lacks():
    nodes = list(ast.walk(ast.parse(SOURCE)))
    assert not [node for node in nodes if isinstance(node, MICROPYTHON_LACKS)]
    displays = [node for node in nodes if isinstance(node, ast.List | ast.Set | ast.Tuple)]
    assert not [star for node in displays for star in node.elts if isinstance(star, ast.Starred)]


def test_the_firmware_runs_without_its_package():
    namespace: dict[str, object] = {}
    exec(compile(SOURCE, "firmware.py", "exec"), namespace)
    assert namespace["crc8"](b"123456789") == 0xF4
