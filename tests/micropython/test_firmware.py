"""firmware.py sends the same bytes under MicroPython as under CPython."""

import importlib.util
import random
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import firmware_sim.firmware

pytestmark = pytest.mark.micropython

HERE = Path(__file__).parent
ROOM = HERE.parents[1] / "firmware_sim"
README = (ROOM / "README.md").read_text(encoding="utf-8")
TRANSCRIPTS = re.findall(r"```transcript\n(.*?)```", README, re.DOTALL)
DOCUMENTED = re.findall(r"^> (.*)", "\n".join(TRANSCRIPTS), re.MULTILINE)
EDGES = {", strobe on": ["+"], ", strobe off": ["-"], ", part": ["*"], "": []}
NUMBERS = ["0", "1", "3", "4", "-1", "50", "100", "101", "1000", "50000", "60000001", "+1", "1.5"]
PUNCTUATION = [" ", ",", "#7 ", "~", "\r", "?", "\xb2", "\0", "é"]


@pytest.fixture(scope="module")
def reference() -> ModuleType:
    """bench.py under CPython."""
    spec = importlib.util.spec_from_file_location("bench", HERE / "bench.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["firmware"] = firmware_sim.firmware
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules["firmware"]
    return module


def headers(reference: ModuleType) -> list[str]:
    return sorted(reference.Device().firmware._commands)


@pytest.mark.parametrize("transcript", TRANSCRIPTS)
def test_readme_transcript(bench, transcript):
    words, expected = [], ""
    for line in transcript.splitlines():
        kind, text = line[0], line[2:]
        if kind == ">":
            words.append((text + "\n").encode().hex())
        elif kind == "+":
            passed_us, _, edge = text.partition(" us")
            words += ["@" + passed_us, *EDGES[edge]]
        else:
            expected += text + "\n"
    assert bench.answers(" ".join(words)) == [expected.encode()]


def random_requests(known: list[str], count: int, seed: int) -> list[str]:
    """Valid, wrong and truncated commands, with pauses and edges between them."""
    chance = random.Random(seed)

    def line() -> bytes:
        numbers = ",".join(chance.choices(NUMBERS, k=chance.choice([0, 0, 1, 1, 2, 3, 6, 20])))
        invented = f"{chance.choice(known)} {numbers}"
        text = (invented if chance.random() < 0.5 else chance.choice(DOCUMENTED)).encode()
        if chance.random() < 0.3:
            text = b"#%d %s" % (chance.randrange(70000), text)
        if chance.random() < 0.3:
            text += b"~%02X" % firmware_sim.firmware.crc8(text)
        for _ in range(chance.choice([0, 0, 0, 0, 1, 2])):
            place = chance.randrange(len(text) + 1)
            text = text[:place] + chance.choice(PUNCTUATION).encode("latin-1") + text[place:]
        return text + b"\n" * chance.choice([1, 1, 1, 0])

    def word() -> str:
        happening = chance.random()
        if happening < 0.15:
            return "@" + str(chance.randrange(300_000))
        return chance.choice("+-*") if happening < 0.3 else line().hex()

    return [" ".join(word() for _ in range(chance.randrange(1, 12))) for _ in range(count)]


def test_random_lines(bench, reference):
    requests = random_requests(headers(reference), 300, seed=1)
    expected = [reference.answer(request) for request in requests]
    assert bench.answers(*requests) == expected
    whole = b"".join(expected)
    # the requests have many successes and many kinds of errors
    assert whole.count(b"OK") > 200
    assert len(set(re.findall(rb"ERR (-?\d+)", whole))) >= 8


@settings(max_examples=20)
@given(batch=st.lists(st.lists(st.binary(min_size=1, max_size=90), max_size=6), max_size=30))
def test_any_bytes(bench, reference, batch):
    requests = [" ".join(piece.hex() for piece in pieces) for pieces in batch]
    assert bench.answers(*requests) == [reference.answer(request) for request in requests]


def test_memory_does_not_grow(new_pico):
    pico = new_pico(HERE / "bench.py", ROOM / "firmware.py")
    thousand_lines = "for _ in range(70): device.exercise()\ngc.collect()"
    used_bytes = []
    with pico.prompt() as execute:
        execute("import bench, gc\ndevice = bench.Device()")
        for _ in range(24):
            execute(thousand_lines)
            used_bytes.append(int(execute("print(gc.mem_alloc())")))
    # During the first thousands, names and the like are allocated once. After that the conservative
    # garbage collector may hold a few blocks, but a leak takes one of 16 bytes in every thousand.
    settled, *later = used_bytes[3:]
    assert later[-1] - settled < 16 * len(later), used_bytes
