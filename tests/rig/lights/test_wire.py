"""Lines of the host and the firmware understand each other; damage is detected."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import SimulatedBoard, VirtualClock, crc8
from firmware_sim.firmware import MAX_SEQUENCE, Firmware
from rig.lights.link import GarbledReplyError, Reply, decode_reply, encode_command

sequences = st.integers(1, MAX_SEQUENCE)
commands = st.one_of(
    st.sampled_from(
        ["*IDN?", "*RST", "LED:OFF", "LED:STAT?", "SYST:ERR?", "LED:SEL 9", "NONSENSE"]
    ),
    st.builds("LED:SEL {}".format, st.integers(0, 3)),
    st.builds("LED:LEV {},{}".format, st.integers(0, 3), st.integers(0, 100)),
)


def replies_of_firmware(data: bytes) -> list[bytes]:
    board = SimulatedBoard(VirtualClock())
    firmware = Firmware(board)
    board.take_output()
    board.receive(data)
    firmware.poll()
    return board.take_output().splitlines()


@given(sequences, commands)
def test_the_firmware_understands_every_line_and_its_reply_is_intact(
    sequence: int, command: str
) -> None:
    (line,) = replies_of_firmware(encode_command(sequence, command))
    reply = decode_reply(line)
    assert reply.sequence == sequence
    assert reply.ok == (command not in ("LED:SEL 9", "NONSENSE"))
    if command.startswith("LED:LEV"):
        assert reply.text == command.removeprefix("LED:LEV ")


@given(sequences, commands, st.data())
def test_a_damaged_byte_in_a_reply_is_noticed(
    sequence: int, command: str, data: st.DataObject
) -> None:
    (line,) = replies_of_firmware(encode_command(sequence, command))
    place = data.draw(st.integers(0, len(line) - 1))
    damaged = bytearray(line)
    damaged[place] ^= data.draw(st.integers(1, 255))
    with pytest.raises(GarbledReplyError):
        decode_reply(bytes(damaged))


@given(st.binary(max_size=40))
def test_noise_is_garbled_or_an_intact_reply_by_its_own_checksum(noise: bytes) -> None:
    try:
        decode_reply(noise)
    except GarbledReplyError:
        return
    body, _, crc = noise.rpartition(b"~")
    assert crc8(body) == int(crc, 16)


@pytest.mark.parametrize(
    "body", [b"", b"OKAY", b"# OK", b"#1 OK\x00", b"#123456 OK", b"#1  OK", b"ok", b"#1 OK\n"]
)
def test_a_line_that_is_not_a_reply_is_garbled(body: bytes) -> None:
    with pytest.raises(GarbledReplyError):
        decode_reply(body + b"~%02X" % crc8(body))


def test_the_examples_of_the_protocol_are_decoded() -> None:
    assert encode_command(7, "LED:SEL 2") == b"#7 LED:SEL 2~E0\n"
    assert decode_reply(b"#7 OK 2,2000~7D") == Reply(sequence=7, ok=True, text="2,2000")
    assert decode_reply(b'ERR -360,"Communication error"~AD') == Reply(
        sequence=None, ok=False, text='-360,"Communication error"'
    )
    with pytest.raises(GarbledReplyError):
        decode_reply(b"#7 OK 2,1000")
