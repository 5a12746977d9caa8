"""The file of the users, and `cellctl users` that changes it."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.exit_codes import Exit
from cellctl.cli.verbs import app
from cellctl.console.users import User, hashed_password, read_users, user_by_password, user_by_token, write_users
from cellctl.files import InputError
from tests.helpers.people import PASSWORD, users_file

HASHED = hashed_password(PASSWORD)


def users(*words: str | Path, password: str = "", monkeypatch: pytest.MonkeyPatch | None = None) -> int:
    if monkeypatch:
        monkeypatch.setattr("sys.stdin", io.StringIO(password + "\n"))
    return exit_codes.exit_code_of(lambda: app(["users", *map(str, words)], standalone_mode=False))


def test_users_are_added_changed_listed_and_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "users.yaml"
    at = ("--users", file)
    assert users("add", "Ada  L.", "--role", "view", *at, password=PASSWORD, monkeypatch=monkeypatch) == Exit.GOOD
    assert file.stat().st_mode & 0o777 == 0o600
    assert users("add", "Bo", "--role", "operate", *at, password=PASSWORD, monkeypatch=monkeypatch) == Exit.GOOD
    assert users("role", "Ada L.", "engineer", *at) == Exit.GOOD
    assert users("password", "Bo", *at, password="another long one", monkeypatch=monkeypatch) == Exit.GOOD
    capsys.readouterr()
    assert users("token", "Bo", *at) == Exit.GOOD
    token = capsys.readouterr().out.strip()
    known = read_users(file)
    assert user_by_token(known, token) == known["Bo"]
    assert token not in file.read_text()
    assert user_by_password(known, "Ada L.", PASSWORD) == known["Ada L."]
    assert user_by_password(known, "Bo", "another long one") == known["Bo"]
    assert user_by_password(known, "Bo", PASSWORD) is None
    assert users("list", *at, "--json", "-") == Exit.GOOD
    assert json.loads(capsys.readouterr().out)["users"] == [
        {"name": "Ada L.", "role": "engineer", "token": False},
        {"name": "Bo", "role": "operate", "token": True},
    ]
    assert users("token", "Bo", "--remove", *at) == Exit.GOOD
    assert user_by_token(read_users(file), token) is None
    assert users("remove", "Ada L.", *at) == users("remove", "Bo", *at) == Exit.GOOD
    assert read_users(file) == {}
    assert file.stat().st_mode & 0o777 == 0o600


def test_a_change_that_is_refused_leaves_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = users_file(tmp_path)
    before = file.read_text()
    at = ("--users", file)
    assert users("add", "Ada", "--role", "view", *at) == Exit.BAD_INPUT
    assert users("add", "Di", "--role", "view", *at, password="short", monkeypatch=monkeypatch) == Exit.BAD_INPUT
    assert users("remove", "Di", *at) == users("role", "Di", "view", *at) == Exit.BAD_INPUT
    assert users("add", "Di", "--role", "chief", *at) == Exit.BAD_INPUT
    assert file.read_text() == before
    assert "one of: Ada, Bo, Cy" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["on", "12", "null", 'Jürgen: O\'Neill # "x" \\', "-", "李"])
def test_any_name_is_read_as_it_was_written(tmp_path: Path, name: str) -> None:
    file = tmp_path / "users.yaml"
    write_users(file, [User(name, "view", HASHED)])
    assert read_users(file) == {name: User(name, "view", HASHED)}


@pytest.mark.parametrize(
    ("wrong", "place", "words"),
    [
        ('role: "viewer"', ":3:11", "'view', 'operate' or 'engineer'"),
        ('role: "view"\n    rank: 1', ":4:5", "'rank' is not known here"),
        ('role: "view"\n    token: "123"', ":4:12", "token"),
        ('role: "view"\n    password: "{}"\n  - name: "Cy"\n    role: "view"', ":5:11", "'Cy' is there twice"),
        ('role: "view"\n    password: "{}"\n  - name: " Di"\n    role: "view"', ":5:11", "write it 'Di'"),
    ],
)
def test_what_is_wrong_in_the_file_is_said_with_its_line(tmp_path: Path, wrong: str, place: str, words: str) -> None:
    file = tmp_path / "users.yaml"
    write_users(file, [User("Cy", "view", HASHED)])
    text = re.sub('role: "view"', lambda _: wrong.replace("{}", HASHED), file.read_text())
    file.write_text(text)
    with pytest.raises(InputError) as refused:
        read_users(file)
    assert f"users.yaml{place}" in str(refused.value)
    assert words in str(refused.value)


def test_a_plain_password_in_the_file_is_refused_and_not_shown_as_a_hash(tmp_path: Path) -> None:
    file = tmp_path / "users.yaml"
    file.write_text('users:\n  - name: "Ada"\n    role: "view"\n    password: "my password"\n')
    file.chmod(0o600)
    with pytest.raises(InputError, match=r"4:15: users\.0\.password"):
        read_users(file)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620])
def test_a_file_that_others_may_read_or_write_is_refused(tmp_path: Path, mode: int) -> None:
    file = users_file(tmp_path)
    file.chmod(mode)
    with pytest.raises(InputError, match="chmod 600"):
        read_users(file)
    assert (
        exit_codes.exit_code_of(
            lambda: app(["console", "--users", str(file), "--runs", str(tmp_path)], standalone_mode=False)
        )
        == Exit.BAD_INPUT
    )


def test_what_the_file_keeps_of_a_user_is_in_no_text_of_it() -> None:
    shown = repr(User("Ada", "view", HASHED, "0" * 64))
    assert HASHED not in shown
    assert "0000" not in shown
