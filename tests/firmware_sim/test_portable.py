"""The firmware loads on MicroPython: no imports at run time. `tests/micropython` compiles it."""

import ast
from pathlib import Path

import firmware_sim.firmware

SOURCE = Path(firmware_sim.firmware.__file__).read_text(encoding="utf-8")


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


def test_the_firmware_runs_without_its_package():
    namespace: dict[str, object] = {}
    exec(compile(SOURCE, "firmware.py", "exec"), namespace)
    assert namespace["crc8"](b"123456789") == 0xF4
