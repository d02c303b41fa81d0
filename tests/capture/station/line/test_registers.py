"""The table of registers: its codec, and what Modbus allows."""

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.station.domain.interface_config import ModbusConfig
from capture.station.line.handshake import MAX_WAITING
from capture.station.line.registers import (
    PLC,
    PLC_ADDRESS,
    PLC_WORDS,
    STATION,
    STATION_WORDS,
    Command,
    Register,
    Status,
    decoded,
    encoded,
)
from capture.station.run.triggers import Refusal

BOTH = pytest.mark.parametrize("registers", [STATION, PLC])


def value_of(register: Register) -> st.SearchStrategy[Any]:
    if register.type == "text":
        ids = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]*", fullmatch=True)
        return ids.map(lambda text: text[: 2 * register.words]) | st.just("")
    return st.integers(0, (1 << 16 * register.words) - 1)


@BOTH
def test_a_page_fits_into_one_request_and_has_no_gaps(registers: tuple[Register, ...]) -> None:
    for before, after in pairwise(registers):
        assert after.address == before.address + before.words
    assert min(125, PLC_ADDRESS) >= STATION_WORDS
    assert PLC_WORDS <= 123


@BOTH
@given(data=st.data())
def test_values_come_back_from_their_words(
    registers: tuple[Register, ...], data: st.DataObject
) -> None:
    values = {each.name: data.draw(value_of(each)) for each in registers}
    words = encoded(registers, values)
    assert all(0 <= word <= 0xFFFF for word in words)
    assert decoded(registers, words) == values


def test_every_bit_and_code_has_a_meaning() -> None:
    assert all(bit.meaning for bit in (*Status, *Command))
    assert all(code.meaning for code in Refusal)
    assert Refusal.RESULTS_WAITING.meaning.startswith(f"{MAX_WAITING} results")


def test_a_recipe_has_one_position() -> None:
    assert ModbusConfig(recipes=("steel", "brass")).recipes == ("steel", "brass")
    with pytest.raises(ValueError, match="named twice"):
        ModbusConfig(recipes=("steel", "brass", "steel"))
