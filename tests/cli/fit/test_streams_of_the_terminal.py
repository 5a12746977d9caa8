"""Standard streams on a bad day: the reader leaves, the disk is full, the terminal knows few letters, Ctrl-C comes."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = [sys.executable, "-B", "-m", "cellctl"]


def complaints(ended):
    """What it wrote to stderr, without the progress that a fit shows where it takes longer than 2 s."""
    return re.sub(rb"(?m)^.*: \d+ %.*\n", b"", ended.stderr)


@pytest.fixture
def run(files):
    """Runs `cellctl` as a program of its own in the folder of the files."""

    def ended(*words, program=MODULE, **more):
        more = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "timeout": 120, "check": False, **more}
        return subprocess.run([*program, *words], cwd=files, **more)

    return ended


@pytest.fixture
def model(cellctl, files, capsys):
    """A model of the positions."""
    assert cellctl("fit", "robot.yaml", "positions.csv", "--model", "geometry", "--out", "model.json") == 0
    capsys.readouterr()
    return files / "model.json"


@pytest.mark.long
@pytest.mark.parametrize(("terms", "code"), [("geometry", 0), ("registration", 1)])
def test_who_reads_only_the_head_gets_the_verdicts_code_and_every_file(run, files, terms, code):
    reader, writer = os.pipe()
    os.close(reader)
    words = ["fit", "robot.yaml", "positions.csv", "--model", terms, "--out", "m.json", "--json", "r.json"]
    try:
        ended = run(*words, stdout=writer)
    finally:
        os.close(writer)
    assert (ended.returncode, complaints(ended)) == (code, b"")
    assert json.loads((files / "r.json").read_text())["model"] == terms
    assert (files / "m.json").exists()


@pytest.mark.long
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_behind_stdout_is_named_and_ends_with_2(run, model):
    with Path("/dev/full").open("wb") as full:
        ended = run("predict", str(model), "positions.csv", stdout=full)
    assert ended.returncode == 2
    assert ended.stderr == b"cellctl: stdout: No space left on device\n"


@pytest.mark.long
def test_closed_streams_end_nothing_and_no_words_get_into_the_files(run, files, model):
    closed = {"preexec_fn": lambda: os.closerange(0, 3), "stdout": None, "stderr": None}
    assert run("predict", str(model), "positions.csv", "-o", "tcp.csv", **closed).returncode == 0
    expected = run("predict", str(model), "positions.csv").stdout
    assert (files / "tcp.csv").read_bytes() == expected
    assert run("predict", str(model), "missing.csv", **closed).returncode == 2


@pytest.mark.long
@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_without_greek_letters_ends_nothing_and_files_to_stdout_are_utf8(run, files, encoding):
    (files / "robot.yaml").write_text((files / "robot.yaml").read_text().replace("elbow arm", "Ärmchen σ"))
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    robot = run("convert", "robot.yaml", "--to", "mdh-hayati", env=environment)
    assert (robot.returncode, robot.stderr) == (0, b"")
    assert "Ärmchen σ" in robot.stdout.decode()
    words = run("fit", "robot.yaml", "positions.csv", "--model", "registration", env=environment)
    assert (words.returncode, complaints(words)) == (1, b"")
    assert b"1 \\u03c3 over the joints" in words.stdout


INTERRUPTED = """\
import os, signal, sys
from pathlib import Path

class Interrupt:
    def find_spec(self, name, *_):
        if name == "{}":
            os.kill(os.getpid(), signal.{})

sys.meta_path.insert(0, Interrupt())
from cellctl.cli.main import main
main()
"""


@pytest.mark.parametrize("while_importing", ["typer", "cellctl.cli.verbs", "pydantic", "numpy", "scipy"])
def test_ctrl_c_while_anything_is_imported_ends_in_one_line_with_130(run, while_importing):
    ends_in_one_line_with_130(run, while_importing, "SIGINT")


@pytest.mark.parametrize("sigint", [signal.SIG_DFL, signal.SIG_IGN])
def test_sigterm_ends_like_ctrl_c_in_a_job_that_a_script_started_with_an_ampersand_too(run, sigint):
    before = {"preexec_fn": lambda: signal.signal(signal.SIGINT, sigint)}
    ends_in_one_line_with_130(run, "scipy", "SIGTERM", **before)


def ends_in_one_line_with_130(run, while_importing, signal_name, **more):
    program = [sys.executable, "-B", "-c", INTERRUPTED.format(while_importing, signal_name)]
    ended = run("fit", "robot.yaml", "positions.csv", "--out", "m.json", program=program, **more)
    assert (ended.returncode, ended.stdout, complaints(ended)) == (130, b"", b"cellctl: aborted by the operator\n")


def test_ctrl_c_in_a_fit_is_reported(cellctl, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("cellctl.operations.fitting.fit", interrupted)
    assert cellctl("fit", "robot.yaml", "positions.csv") == 130
    assert capsys.readouterr() == ("", "cellctl: aborted by the operator\n")
