"""A serial port as any driver uses it: its address, opening it, writing to it."""

from __future__ import annotations

import errno
import os
import pty

import pytest

from cellctl.devices import Address, DeviceUnreachable
from drivers.serial_port import SerialPlace, open_port


def at(path: str, query: str = "") -> SerialPlace:
    return SerialPlace.of(Address.parse(f"geocom+serial://{path}{query}"), 115_200)


def test_an_address_says_port_and_baud_rate_and_the_driver_the_default():
    assert str(at("/dev/ttyUSB0")) == "/dev/ttyUSB0 at 115200 baud"
    assert str(at("/dev/ttyUSB0", "?baud=9600")) == "/dev/ttyUSB0 at 9600 baud"


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("host/dev/ttyUSB0", "three slashes, as geocom"),
        ("", "names no serial port"),
        ("/dev/ttyUSB0?baud=0", "baud"),
        ("/dev/ttyUSB0?baud=fast", "baud"),
    ],
)
def test_an_address_that_cannot_be_meant_is_refused(path, words):
    with pytest.raises(ValueError, match=words):
        at(path)


def test_a_port_that_is_not_there_asks_for_the_device_by_its_name():
    with pytest.raises(DeviceUnreachable, match="ENOENT") as caught:
        open_port("tracker", at("/dev/tty-that-is-not-there"))
    assert "is the tracker plugged in?" in caught.value.cure


def test_a_port_without_permission_names_the_group(monkeypatch):
    def refuse(*_args, **_kwargs):
        raise PermissionError(errno.EACCES, "Permission denied")

    master, slave = pty.openpty()
    path, real_open = os.ttyname(slave), os.open
    monkeypatch.setattr(os, "open", lambda p, *rest: refuse() if p == path else real_open(p, *rest))
    try:
        with pytest.raises(DeviceUnreachable) as caught:
            open_port("tracker", at(path))
        assert "dialout" in caught.value.cure
    finally:
        os.close(master)
        os.close(slave)


def test_a_file_that_is_no_terminal_is_unreachable(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DeviceUnreachable) as caught:
        open_port("tracker", at(str(tmp_path / "file")))
    assert "`geocom+serial:///dev/ttyACM0?baud=115200`" in caught.value.cure


@pytest.fixture
def line():
    """An open port, and the other end of its line."""
    master, slave = pty.openpty()
    opened = open_port("tracker", at(os.ttyname(slave)))
    yield opened, master
    opened.close()
    os.close(master)
    os.close(slave)


def test_a_line_that_the_port_took_is_sent_however_long_its_thread_was_kept_waiting(line, monkeypatch):
    monkeypatch.setattr("serial.serialutil.Timeout.expired", lambda _: True)  # as on a machine that is busy just then
    opened, other_end = line
    opened.write(b"ACK,1\n")
    assert os.read(other_end, 100) == b"ACK,1\n"


def test_a_port_whose_line_nobody_takes_says_so(line):
    opened, _ = line
    with pytest.raises(TimeoutError):
        opened.write(b"x" * 1_000_000)
