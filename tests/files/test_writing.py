"""Files that are whole, and values that have one text."""

from __future__ import annotations

import errno
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import canonical_json, sha256_of, write_atomically

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)


def test_what_is_written_is_read_back(tmp_path):
    write_atomically(tmp_path / "f", "Größe\n")
    assert (tmp_path / "f").read_bytes() == "Größe\n".encode()
    write_atomically(tmp_path / "f", b"\x00\xff")
    assert (tmp_path / "f").read_bytes() == b"\x00\xff"
    assert [p.name for p in tmp_path.iterdir()] == ["f"]


@pytest.mark.parametrize("failing", ["fsync", "replace", "chmod"])
def test_a_full_disk_leaves_the_old_file_and_nothing_beside_it(tmp_path, monkeypatch, failing):
    target = tmp_path / "f"
    target.write_text("old")

    def full(*_args, **_kwargs):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, failing, full)
    with pytest.raises(OSError, match="No space"):
        write_atomically(target, "new")
    monkeypatch.undo()
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["f"]


def test_a_file_that_is_replaced_keeps_its_permissions_and_a_new_one_has_what_the_umask_leaves(tmp_path):
    (tmp_path / "own").write_text("old")
    (tmp_path / "own").chmod(0o600)
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / "own", "new")
        write_atomically(tmp_path / "fresh", "new")
    finally:
        os.umask(before)
    assert (tmp_path / "own").stat().st_mode & 0o777 == 0o600
    assert (tmp_path / "fresh").stat().st_mode & 0o777 == 0o640


def test_a_link_stays_a_link_and_what_it_points_to_is_written(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there/f")
    write_atomically(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "f").read_text() == "new"


def test_a_fifo_takes_what_is_written_and_stays_a_fifo(tmp_path):
    os.mkfifo(tmp_path / "f")
    reader = os.open(tmp_path / "f", os.O_RDONLY | os.O_NONBLOCK)
    write_atomically(tmp_path / "f", "new")
    assert os.read(reader, 10) == b"new"
    os.close(reader)
    assert (tmp_path / "f").is_fifo()


def test_a_stream_that_leads_to_a_file_is_added_to_and_what_was_there_stays(tmp_path):
    (tmp_path / "log").write_text("old\n")
    with (tmp_path / "log").open("ab") as log:
        (tmp_path / "link").symlink_to(f"/dev/fd/{log.fileno()}")
        write_atomically(Path(f"/dev/fd/{log.fileno()}"), "new\n")
        write_atomically(tmp_path / "link", "newer\n")
    assert (tmp_path / "log").read_text() == "old\nnew\nnewer\n"


def test_the_longest_name_that_a_file_can_have_can_be_written(tmp_path):
    write_atomically(tmp_path / ("f" * 255), "new")
    assert (tmp_path / ("f" * 255)).read_text() == "new"


def test_text_that_utf8_cannot_hold_leaves_the_old_file(tmp_path):
    (tmp_path / "f").write_text("old")
    with pytest.raises(UnicodeEncodeError):
        write_atomically(tmp_path / "f", "\ud800")
    assert (tmp_path / "f").read_text() == "old"


def test_no_folder_is_opened_where_the_system_cannot_do_it_as_on_windows(tmp_path, monkeypatch):
    monkeypatch.delattr(os, "O_DIRECTORY")
    monkeypatch.setattr(os, "open", lambda *_: pytest.fail("a folder was opened"))
    write_atomically(tmp_path / "f", "new")
    assert (tmp_path / "f").read_text() == "new"


def test_a_folder_that_is_missing_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        write_atomically(tmp_path / "nowhere" / "f", "x")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_leaves_the_old_file(tmp_path):
    (tmp_path / "f").write_text("old")
    tmp_path.chmod(0o555)
    try:
        with pytest.raises(PermissionError):
            write_atomically(tmp_path / "f", "new")
    finally:
        tmp_path.chmod(0o755)
    assert (tmp_path / "f").read_text() == "old"


def test_a_reader_never_sees_half_a_file(tmp_path):
    """Another process reads as fast as it can while the file is replaced; each time it finds one whole version."""
    target = tmp_path / "f"
    size = 200_000
    write_atomically(target, "a" * size)
    watch = (
        "import pathlib, sys\n"
        "p = pathlib.Path(sys.argv[1]); seen = set(); print('ready', flush=True)\n"
        "while 'z' not in seen:\n"
        "    text = p.read_text(); seen |= set(text)\n"
        f"    assert len(text) == {size} and len(set(text)) == 1, (len(text), set(text))\n"
    )
    reader = subprocess.Popen([sys.executable, "-c", watch, str(target)], stdout=subprocess.PIPE)
    assert reader.stdout.readline() == b"ready\n"
    for letter in "bcdefghijklmnopqrstuvwxyz":
        write_atomically(target, letter * size)
    assert reader.wait(timeout=120) == 0


@given(VALUES)
def test_canonical_json_reads_back_and_is_the_same_again(value):
    text = canonical_json(value)
    assert json.loads(text) == value
    assert canonical_json(json.loads(text)) == text


@given(st.dictionaries(st.text(), st.integers(), min_size=2))
def test_the_order_of_keys_does_not_matter(value):
    turned = dict(reversed(value.items()))
    assert canonical_json(turned) == canonical_json(value)
    assert sha256_of(turned) == sha256_of(value)


def test_canonical_json_has_no_spaces_sorted_keys_and_letters_as_they_are():
    assert canonical_json({"b": [1, 2.5], "a": "é"}) == '{"a":"é","b":[1,2.5]}'


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_numbers_that_json_cannot_hold_are_refused(number):
    with pytest.raises(ValueError):
        canonical_json({"a": [number]})


def test_what_json_does_not_know_is_refused():
    with pytest.raises(TypeError):
        canonical_json({"a": object()})


def test_hashes_are_of_the_content_itself():
    """Check value of SHA-256 of 'abc', FIPS 180-2, B.1."""
    expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert sha256_of("abc") == sha256_of(b"abc") == expected
    assert sha256_of({"a": 1}) == sha256_of('{"a":1}')
