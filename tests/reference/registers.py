"""The page of the PLC: registers, bits and codes."""

from capture.station.domain.verdict import Cause
from capture.station.line.registers import (
    COMMAND_MEANINGS,
    ERROR_MEANINGS,
    PLC,
    SELECT_ERROR_MEANINGS,
    STATES,
    STATION,
    STATUS_MEANINGS,
    VERDICTS,
    Command,
    Register,
    Status,
)


def registers_page() -> str:
    """Return the page of registers as Markdown, for the reference."""
    lines = ["| register | name | type | | meaning |", "|---|---|---|---|---|"]
    for direction, registers in (("station to PLC", STATION), ("PLC to station", PLC)):
        lines += [
            f"| {_range(register)} | `{register.name}` | {register.type} | {direction} | "
            f"{register.meaning} |"
            for register in registers
        ]
    lines += ["", "| bit | of `status` | set while |", "|---|---|---|"]
    lines += [_bit_row(bit, STATUS_MEANINGS[bit]) for bit in Status]
    lines += ["", "| bit | of `commands` | meaning |", "|---|---|---|"]
    lines += [_bit_row(bit, COMMAND_MEANINGS[bit]) for bit in Command]
    lines += ["", "| `error` | the trigger was refused because |", "|---|---|"]
    lines += [f"| {code:d} | {meaning} |" for code, meaning in ERROR_MEANINGS.items()]
    lines += ["", "| `select_error` | the recipe was not loaded because |", "|---|---|"]
    lines += [f"| {code:d} | {meaning} |" for code, meaning in SELECT_ERROR_MEANINGS.items()]
    lines += ["", "| code of | values |", "|---|---|"]
    for name, codes in (("verdict", VERDICTS), ("state", STATES)):
        values = ", ".join(f"{code} {word}" for word, code in codes.items())
        lines.append(f"| `{name}` | {values} |")
    lines += ["", "| `cause` | verdict | | the part did not pass because |", "|---|---|---|---|"]
    lines += [f"| {row.plc_code} | {row.decision} | {row} | {row.meaning} |" for row in Cause]
    return "\n".join(lines)


def _range(register: Register) -> str:
    first, last = register.address, register.address + register.words - 1
    return f"{first}" if first == last else f"{first}-{last}"


def _bit_row(bit: Status | Command, meaning: str) -> str:
    name = "".join(word.capitalize() for word in str(bit.name).split("_"))
    return f"| {bit.value.bit_length() - 1} | {name} | {meaning} |"
