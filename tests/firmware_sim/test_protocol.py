"""Exact bytes of every command, every error, and the transcripts of the README."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "firmware_sim" / "README.md").read_text(encoding="utf-8")
TRANSCRIPTS = re.findall(r"```transcript\n(.*?)```", README, re.DOTALL)


def test_the_readme_has_its_transcripts():
    assert len(TRANSCRIPTS) == 4


@pytest.mark.parametrize("transcript", TRANSCRIPTS)
def test_the_device_replies_as_in_the_readme(new_device, transcript):
    device = new_device(pass_us=(100.0, 100.0))
    received = device.banner.decode()
    for line in transcript.splitlines():
        if line.startswith("> "):
            assert received == "", "the README leaves out a reply"
            received = device.exchange(line[2:].encode() + b"\n").decode()
        elif line.startswith("+ "):
            passed_us, _, edge = line[2:].partition(" us")
            device.clock.sleep_s(int(passed_us) / 1e6)
            if edge == ", part":
                device.see_part()
            elif edge:
                device.strobe({", strobe on": True, ", strobe off": False}[edge])
        else:
            assert line == "< " + received.removesuffix("\n")
            received = ""
    assert received == ""


@pytest.mark.parametrize(
    ("sent", "reply"),
    [
        (b"*IDN?\n", b"OK PS4RIG,LED4,SIM-0001,2.1.0,2\n"),
        (b"*RST\n", b"OK\n"),
        (b"SYST:ERR?\n", b'OK 0,"No error"\n'),
        (b"SYST:WDOG 100\n", b"OK 100\n"),
        (b"SYST:WDOG 60000\n", b"OK 60000\n"),
        (b"SYST:WDOG?\n", b"OK 5000\n"),
        (b"LED:SEL 0\n", b"OK 0,1000\n"),
        (b"LED:SEL 3\n", b"OK 3,1000\n"),
        (b"LED:OFF\n", b"OK -1,1000\n"),
        (b"LED:LEV 3,0\n", b"OK 3,0\n"),
        (b"LED:LEV 3,100\n", b"OK 3,100\n"),
        (b"LED:LEV? 3\n", b"OK 3,100\n"),
        (b"LED:LIM? 3\n", b"OK 3,120000,50\n"),
        (b"PART:WAIT 60000000\n", b"OK 60000000\n"),
        (b"PART:STAT?\n", b"OK 0,-1,1000\n"),
        (b"SEQ:ARM 0,100000,-1\n", b"OK 1000\n"),
        (b"SEQ:TRIG 0,60000000" + b",-1" * 14 + b"\n", b"OK 1000\n"),
        (b"SEQ:STAT?\n", b"OK 0,0,0,0,0,0,1000\n"),
        (b"LED:STAT?\n", b"OK -1,100,100,100,100,1000\n"),
        # As people type
        (b"led:sel 2\r\n", b"OK 2,1000\n"),
        (b"  Led:Sel   002  \r\n", b"OK 2,1000\n"),
        (b"LED:LEV 1 , 50\n", b"OK 1,50\n"),
        (b"#5 led:sel 2\r\n", b"#5 OK 2,1000\n"),
        (b" #65535   *rst \n", b"#65535 OK\n"),
    ],
)
def test_an_accepted_command_has_its_reply(device, sent, reply):
    assert device.exchange(sent) == reply
    assert device.exchange(b"SYST:ERR?\n") == b'OK 0,"No error"\n'


@pytest.mark.parametrize(
    ("sent", "error"),
    [
        (b"\n", b'-102,"Syntax error"'),
        (b"LED:SEL 1\r\r\n", b'-101,"Invalid character"'),
        (b"LED:SEL 1\0\n", b'-101,"Invalid character"'),
        (b"LED:SEL \xb2\n", b'-101,"Invalid character"'),
        (b"LED:SEL 1;LED:OFF\n", b'-102,"Syntax error"'),
        (b"HELLO\n", b'-113,"Undefined header"'),
        (b"LED :SEL 1\n", b'-113,"Undefined header"'),
        (b"LED:LEV 1,\n", b'-109,"Missing parameter"'),
        (b"LED:LEV ,1\n", b'-109,"Missing parameter"'),
        (b"LED:SEL 1,2\n", b'-108,"Parameter not allowed"'),
        (b"LED:OFF 1\n", b'-108,"Parameter not allowed"'),
        (b"LED:SEL -1\n", b'-222,"Data out of range"'),
        (b"LED:SEL +1\n", b'-102,"Syntax error"'),
        (b"LED:SEL 1.0\n", b'-102,"Syntax error"'),
        (b"LED:LEV 1,1_0\n", b'-102,"Syntax error"'),
        (b"LED:SEL 4\n", b'-222,"Data out of range"'),
        (b"LED:SEL " + b"9" * 56 + b"\n", b'-222,"Data out of range"'),
        (b"LED:LEV 4,50\n", b'-222,"Data out of range"'),
        (b"LED:LEV 1,101\n", b'-222,"Data out of range"'),
        (b"LED:LEV 1,-1\n", b'-222,"Data out of range"'),
        (b"LED:LIM? 4\n", b'-222,"Data out of range"'),
        (b"SEQ:ARM 0,1000\n", b'-109,"Missing parameter"'),
        (b"SEQ:ARM 0,1000" + b",0" * 17 + b"\n", b'-108,"Parameter not allowed"'),
        (b"SEQ:ARM 0,1000,4\n", b'-222,"Data out of range"'),
        (b"SEQ:ARM -1,1000,0\n", b'-222,"Data out of range"'),
        (b"SEQ:ARM 1000,1000,0\n", b'-222,"Data out of range"'),
        (b"SEQ:TRIG 0,60000001,0\n", b'-222,"Data out of range"'),
        (b"SEQ:STEP? 0\n", b'-222,"Data out of range"'),
        (b"PART:WAIT -1\n", b'-222,"Data out of range"'),
        (b"PART:WAIT 60000001\n", b'-222,"Data out of range"'),
        (b"LED:LEV? 4\n", b'-222,"Data out of range"'),
        (b"SYST:WDOG 99\n", b'-222,"Data out of range"'),
        (b"SYST:WDOG 60001\n", b'-222,"Data out of range"'),
        (b"LED:SEL " + b"0" * 56 + b"1\n", b'-363,"Input buffer overrun"'),
        (b"x" * 10_000 + b"\n", b'-363,"Input buffer overrun"'),
        (b"# LED:SEL 1\n", b'-102,"Syntax error"'),
        (b"#1LED:SEL 1\n", b'-102,"Syntax error"'),
        (b"#-1 LED:SEL 1\n", b'-102,"Syntax error"'),
        (b"#65536 LED:SEL 1\n", b'-222,"Data out of range"'),
    ],
)
def test_a_refused_command_has_its_error(device, sent, error):
    device.exchange(b"LED:LEV 1,70\nLED:SEL 1\n")
    before = device.lit()
    assert device.exchange(sent) == b"ERR " + error + b"\n"
    assert device.exchange(b"SYST:ERR?\n") == b"OK " + error + b"\n"
    assert device.exchange(b"SYST:ERR?\n") == b'OK 0,"No error"\n'
    assert device.exchange(b"LED:STAT?\n").startswith(b"OK 1,100,70,100,100,")
    assert device.exchange(b"SYST:WDOG?\n") == b"OK 5000\n"
    assert device.lit() == before == [0.0, 0.7, 0.0, 0.0]


def test_an_error_keeps_its_sequence_id(device):
    assert device.exchange(b"#5 HELLO\n") == b'#5 ERR -113,"Undefined header"\n'
    assert device.exchange(b"#5 LED:SEL \xff\n") == b'#5 ERR -101,"Invalid character"\n'
    assert device.exchange(b"#5 \n") == b'#5 ERR -102,"Syntax error"\n'


def test_the_longest_line_is_64_bytes_without_its_end(device):
    assert device.exchange(b"LED:SEL " + b"0" * 55 + b"1\r\n") == b"OK 1,1000\n"


def test_select_lights_only_one_led_at_its_level(device):
    device.exchange(b"LED:LEV 2,50\nLED:SEL 1\n")
    assert device.lit() == [0.0, 1.0, 0.0, 0.0]
    device.exchange(b"LED:SEL 2\n")
    assert device.lit() == [0.0, 0.0, 0.5, 0.0]
    device.exchange(b"LED:LEV 2,80\nLED:LEV 3,10\n")
    assert device.lit() == [0.0, 0.0, 0.8, 0.0]
    device.exchange(b"LED:OFF\n")
    assert device.lit() == [0.0, 0.0, 0.0, 0.0]


def test_rst_restores_all_settings(device):
    device.exchange(b"LED:LEV 2,50\nLED:SEL 1\nSYST:WDOG 200\nHELLO\n")
    assert device.exchange(b"*RST\n") == b"OK\n"
    assert device.lit() == [0.0, 0.0, 0.0, 0.0]
    assert device.exchange(b"LED:STAT?\n").startswith(b"OK -1,100,100,100,100,")
    assert device.exchange(b"SYST:WDOG?\nSYST:ERR?\n") == b'OK 5000\nOK 0,"No error"\n'


def test_a_stopped_program_is_dark_and_silent_until_the_next_reset(device):
    device.exchange(b"SEQ:TRIG 1000,50000,1,2,3\n")
    assert device.exchange(b"#9 SYST:PROG\n") == b"#9 OK\n"
    assert device.lit() == [0.0, 0.0, 0.0, 0.0]
    assert device.exchange(b"LED:SEL 1\n*IDN?\n") == b""
    assert device.lit() == [0.0, 0.0, 0.0, 0.0]
    device.controller.reset()
    device.clock.sleep_s(1.0)
    assert device.controller.take_output().startswith(b"READY ")
    assert device.exchange(b"LED:SEL 1\n").startswith(b"OK 1,")


def test_a_full_queue_ends_with_an_overflow_entry(device):
    device.exchange(b"LED:SEL 9\n" + b"HELLO\n" * 7)
    device.exchange(b"\n\n")
    entries = device.exchange(b"SYST:ERR?\n" * 9).splitlines()
    assert entries[0] == b'OK -222,"Data out of range"'
    assert entries[1:7] == [b'OK -113,"Undefined header"'] * 6
    assert entries[7:] == [b'OK -350,"Queue overflow"', b'OK 0,"No error"']
