"""A console by https: with the plant's certificate alone, its cookie for https alone, wrong files refused at once."""

from __future__ import annotations

import shutil
import ssl
import subprocess
from pathlib import Path

import httpx
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.exit_codes import Exit
from cellctl.cli.verbs import app
from cellctl.console.guarding import names_of
from tests.helpers.console import console_process

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates")


def made(folder: Path, name: str) -> tuple[Path, Path]:
    """A certificate of 127.0.0.1 that signs itself, and its key."""
    certificate, key = folder / f"{name}.crt", folder / f"{name}.key"
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    command += ["-subj", "/CN=cellctl test", "-addext", "subjectAltName=IP:127.0.0.1", "-days", "2"]
    subprocess.run([*command, "-keyout", str(key), "-out", str(certificate)], check=True, capture_output=True)
    return certificate, key


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return made(tmp_path_factory.mktemp("tls"), "own")


def console(*words: str | Path) -> int:
    return exit_codes.exit_code_of(lambda: app(["console", *map(str, words)], standalone_mode=False))


@pytest.mark.long
def test_a_console_with_a_certificate_answers_by_https_alone(files: tuple[Path, Path], tmp_path: Path) -> None:
    certificate, key = files
    with console_process(tmp_path / "runs", "--tls-cert", str(certificate), "--tls-key", str(key)) as served:
        address = served.url.replace("http://", "https://")
        trusted = ssl.create_default_context(cafile=str(certificate))
        answer = httpx.get(f"{address}/api", verify=trusted)
        assert answer.status_code == 200
        assert "; Secure" in answer.headers["set-cookie"]
        assert httpx.get(f"{address}/metrics", verify=trusted).status_code == 200
        with pytest.raises(httpx.HTTPError):
            httpx.get(served.url.replace("https://", "http://"))
        with pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
            httpx.get(f"{address}/api")


def test_files_that_do_not_belong_together_are_refused(files: tuple[Path, Path], tmp_path: Path, capsys) -> None:
    _, other = made(tmp_path, "other")
    assert console("--tls-cert", files[0], "--tls-key", other) == Exit.BAD_INPUT
    assert console("--tls-cert", files[0], "--tls-key", tmp_path / "missing") == Exit.BAD_INPUT
    assert console("--tls-cert", files[0]) == Exit.BAD_INPUT
    assert "go together" in capsys.readouterr().err


def test_a_key_with_a_password_is_refused_without_asking_for_it(files: tuple[Path, Path], tmp_path: Path) -> None:
    locked = tmp_path / "locked.key"
    command = ["openssl", "ec", "-in", str(files[1]), "-aes256", "-passout", "pass:secret", "-out", str(locked)]
    subprocess.run(command, check=True, capture_output=True)
    assert console("--tls-cert", files[0], "--tls-key", locked) == Exit.BAD_INPUT


def test_a_key_that_every_user_may_read_is_refused(files: tuple[Path, Path], tmp_path: Path, capsys) -> None:
    opened = tmp_path / "open.key"
    opened.write_bytes(files[1].read_bytes())
    opened.chmod(0o644)
    assert console("--tls-cert", files[0], "--tls-key", opened) == Exit.BAD_INPUT
    assert "chmod o=" in capsys.readouterr().err


def test_the_default_port_of_https_is_left_out_of_its_names() -> None:
    assert "127.0.0.1" in names_of("127.0.0.1", 443, "https")
    assert "127.0.0.1" not in names_of("127.0.0.1", 80, "https")
