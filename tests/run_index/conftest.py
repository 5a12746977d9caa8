from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest


class Server:
    """A PostgreSQL server of its own, without password, on a free port of this machine."""

    def __init__(self, programs: Path, folder: Path) -> None:
        self._programs, self._data = programs, folder / "data"
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        shutil.chown(folder, "postgres")
        self._run("initdb", "-D", str(self._data), "-A", "trust", "-N", "-U", "cellctl", "--no-locale", "-E", "UTF8")
        self.start()

    @property
    def url(self) -> str:
        return f"postgresql://cellctl@127.0.0.1:{self.port}/postgres"

    def _run(self, program: str, *words: str) -> None:
        command = ["runuser", "-u", "postgres", "--", str(self._programs / program), *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd="/")
        assert done.returncode == 0, done.stdout + done.stderr

    def start(self) -> None:
        options = f"-p {self.port} -c listen_addresses=127.0.0.1 -c unix_socket_directories={self._data} -c fsync=off"
        log = str(self._data / "log")
        self._run("pg_ctl", "-D", str(self._data), "-w", "-t", "100", "-l", log, "-o", options, "start")

    def kill(self) -> None:
        """Kill it with SIGKILL, and wait until it is gone."""
        process = (self._data / "postmaster.pid").read_text().split()[0]
        subprocess.run(["kill", "-9", process], check=True)
        while Path(f"/proc/{process}").exists():
            pass
        (self._data / "postmaster.pid").unlink()

    def stop(self) -> None:
        self._run("pg_ctl", "-D", str(self._data), "-m", "immediate", "stop")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    programs = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    if not programs or not shutil.which("runuser") or os.getuid():
        pytest.skip("needs PostgreSQL (Debian: postgresql), and root, to run it as its own user")
    with tempfile.TemporaryDirectory(prefix="cellctl-server-", ignore_cleanup_errors=True) as folder:
        found = Server(programs[-1], Path(folder))  # not below pytest's folder, which others may not enter
        yield found
        found.stop()
