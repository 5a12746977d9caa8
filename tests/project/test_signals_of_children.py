"""The tests give the same result however they are started: as a background job, under nohup."""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__)
SIGNALS = "from signal import *; print(getsignal(SIGINT) is default_int_handler, getsignal(SIGHUP) is SIG_DFL)"


def test_children_of_a_test_can_be_interrupted_and_hung_up():
    done = subprocess.run([sys.executable, "-c", SIGNALS], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True"]


def test_they_can_also_where_the_tests_are_a_background_job_under_nohup():
    one = f"{HERE}::{test_children_of_a_test_can_be_interrupted_and_hung_up.__name__}"
    ignoring = ["sh", "-c", "trap '' INT HUP; exec \"$@\"", "sh", sys.executable, "-m", "pytest", "-n", "0", one]
    done = subprocess.run(ignoring, cwd=HERE.parents[2], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout
