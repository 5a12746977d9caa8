"""Lines that several processes append: each whole, none lost, and a full disk changes nothing."""

import subprocess
import sys

from cellctl.files.writing import append_line

WRITER = """
import sys
from pathlib import Path
from cellctl.files.writing import append_line
for number in range(50):
    append_line(Path(sys.argv[1]), f"{sys.argv[2]} {number} " + "x" * 5000)
"""


def test_two_processes_append_at_once_and_every_line_is_whole(tmp_path):
    file = tmp_path / "lines"
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, str(file), name]) for name in "ab"]
    assert [writer.wait(60) for writer in writers] == [0, 0]
    words = [line.split() for line in file.read_text().splitlines()]
    for name in "ab":
        assert [int(number) for who, number, _ in words if who == name] == list(range(50))
    assert {len(text) for _, _, text in words} == {5000}


def test_a_part_of_a_line_stays_a_line_of_its_own(tmp_path):
    file = tmp_path / "lines"
    file.write_text("whole\ncut o")
    append_line(file, "next")
    assert file.read_text() == "whole\ncut o\nnext\n"


FULL = """
import resource, signal, sys
from pathlib import Path
from cellctl.files.writing import append_line
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))
append_line(Path(sys.argv[1]), "a line that does not fit")
"""


def test_a_line_that_does_not_fit_on_the_disk_leaves_the_file_as_it_was(tmp_path):
    file = tmp_path / "lines"
    append_line(file, "whole")
    ended = subprocess.run([sys.executable, "-c", FULL, str(file)], capture_output=True, text=True, check=False)
    assert "OSError" in ended.stderr
    assert file.read_text() == "whole\n"
