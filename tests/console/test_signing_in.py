"""Named users: who signs in and reads, how sessions end, how tries are limited; and the name beside the token."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from cellctl.console import users
from cellctl.console.guarding import Guard, names_of
from cellctl.console.server import refuse_open_passwords
from cellctl.console.shared import Settings
from cellctl.console.users import hashed_password, read_users
from cellctl.files import InputError
from tests.helpers.people import HERE, PASSWORD, Browser, People

IPV6 = "2001:db8:1:2::"


@pytest.fixture
def people(tmp_path: Path) -> People:
    return People.at(tmp_path)


@pytest.fixture
def ada(people: People) -> Browser:
    browser = people.browser()
    assert browser.sign_in("Ada").status_code == 303
    return browser


def cookie(answer: httpx.Response) -> str:
    return answer.headers["set-cookie"].partition("=")[2].partition(";")[0]


def test_nobody_reads_a_console_with_users_who_has_not_signed_in(people: People) -> None:
    browser = people.browser()
    page = browser.get("/runs?text=a")
    assert (page.status_code, page.headers["location"]) == (303, "/login?to=%2Fruns%3Ftext%3Da")
    assert "set-cookie" not in page.headers
    for path in ("/api/console", "/api/runs/x/files/y", "/metrics", "/_nicegui/x.js", "/_nicegui_ws/socket.io"):
        assert browser.get(path).status_code == 401, path
    assert browser.send("POST", "/anything").status_code == 401


def test_who_signs_in_gets_to_the_page_that_was_asked_for_and_reads(people: People) -> None:
    browser = people.browser()
    form = browser.get("/login?to=/runs%3Ftext%3Da")
    assert 'autocomplete="current-password"' in form.text
    assert 'value="/runs?text=a"' in form.text
    answer = browser.sign_in("Ada", to="/runs?text=a")
    assert (answer.status_code, answer.headers["location"]) == (303, "/runs?text=a")
    assert "HttpOnly; SameSite=Strict" in answer.headers["set-cookie"]
    assert browser.reads
    assert browser.get("/login?to=/cell").headers["location"] == "/cell"


def test_who_is_signed_in_and_follows_a_link_of_another_site_is_not_asked_again(people: People, ada: Browser) -> None:
    linked = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
    without_cookie = people.browser().get('/login?to=/runs%3Ftext%3D"a', headers=linked)
    assert 'content="0; url=/runs?text=&#34;a"' in without_cookie.text
    assert "set-cookie" not in without_cookie.headers
    assert ada.get("/login?to=/runs", headers=linked).headers["location"] == "/runs"


@pytest.mark.parametrize("place", ["//evil.example", "https://evil.example", "/\\evil.example", "/a\nb", ""])
def test_a_form_leads_to_no_other_site(people: People, place: str) -> None:
    assert people.browser().sign_in("Ada", to=place).headers["location"] == "/"


def test_an_id_that_the_browser_had_before_is_not_signed_in(people: People) -> None:
    before = people.browser()
    before.client.cookies.set("cellctl_console_8090", "chosen-by-somebody")
    first = cookie(before.sign_in("Ada"))
    second = cookie(before.sign_in("Ada"))
    assert len({"chosen-by-somebody", first, second}) == 3
    for stolen, reads in (("chosen-by-somebody", False), (first, False), (second, True)):
        other = people.browser()
        other.client.cookies.set("cellctl_console_8090", stolen)
        assert other.reads is reads


def test_a_wrong_password_and_an_unknown_name_have_one_answer_and_cost_one_computation(
    people: People, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed: list[str] = []

    class Counting:
        def verify(self, hashed: str, password: str) -> bool:
            computed.append(hashed)
            return hasher.verify(hashed, password)

    hasher = users._HASHER
    monkeypatch.setattr(users, "_HASHER", Counting())
    answers = [people.browser().sign_in(name, "a wrong password") for name in ("Ada", "Nobody")]
    assert [answer.status_code for answer in answers] == [403, 403]
    nonces = [answer.headers["content-security-policy"].partition("'nonce-")[2][:22] for answer in answers]
    assert answers[0].text.replace(nonces[0], nonces[1]).replace("Ada", "Nobody") == answers[1].text
    assert [each.partition("$v=")[2][:16] for each in computed] == ["19$m=19456,t=2,p"] * 2


@pytest.mark.parametrize("name", ["Ada", "Nobody"])
def test_an_address_waits_longer_after_each_failure_and_others_do_not(people: People, name: str) -> None:
    stranger = people.browser("10.0.0.66")
    for _ in range(5):
        assert stranger.sign_in(name, "a wrong password").status_code == 403
    waits = stranger.sign_in("Ada")
    assert (waits.status_code, waits.headers["retry-after"]) == (429, "2")
    assert "Try again in 2 s" in waits.text
    assert people.browser("10.0.0.7").sign_in("Ada").status_code == 303
    people.time_s += 2.1
    assert stranger.sign_in(name, "a wrong password").status_code == 403
    assert stranger.sign_in("Ada").headers["retry-after"] == "4"
    people.time_s += 4.1
    assert stranger.sign_in("Ada").status_code == 303
    assert stranger.sign_in(name, "a wrong password").status_code == 403  # a success took nothing back
    assert stranger.sign_in("Ada").headers["retry-after"] == "8"
    people.time_s += 3601
    assert stranger.sign_in(name, "a wrong password").status_code == 403
    assert stranger.sign_in("Ada").status_code == 303


def test_strangers_at_many_addresses_do_not_lock_a_person_out_where_that_one_has_signed_in(
    people: People, ada: Browser
) -> None:
    for number in range(12):
        people.browser(f"10.0.1.{number}").sign_in("Ada", "a wrong password")
    assert people.browser("10.0.2.1").sign_in("Ada").status_code == 429
    assert ada.sign_in("Ada").status_code == 303
    people.time_s += 10.1
    assert people.browser("10.0.2.1").sign_in("Ada").status_code == 303


def test_a_network_of_ipv6_is_one_address(people: People) -> None:
    for number in range(5):
        people.browser(f"{IPV6}{number}").sign_in(f"Nobody {number}", "a wrong password")
    assert people.browser(f"{IPV6}99").sign_in("Ada").status_code == 429
    assert people.browser("2001:db8:1:3::99").sign_in("Ada").status_code == 303
    assert people.browser("::ffff:10.0.0.5").sign_in("Ada").status_code == 303


def test_a_try_is_in_the_audit_log_but_no_text_that_may_be_a_password(people: People) -> None:
    browser = people.browser()
    browser.sign_in("Ada")
    browser.sign_in("Ada", "a wrong password")
    browser.sign_in("my secret password", "a wrong password")
    lines = [(one["operator"], one["command"], one["outcome"]) for one in people.console.audit.read()]
    assert lines == [
        ("unknown", "sign in", "failed"),
        ("Ada", "sign in", "failed"),
        ("Ada", "sign in", "done"),
    ]
    assert people.console.audit.read()[0]["details"] == {"address": "10.0.0.1"}
    text = (people.console.runs / "audit.jsonl").read_text()
    assert "secret" not in text
    assert "wrong password" not in text.replace("name or password is wrong", "")


@pytest.mark.parametrize("ends", ["idle", "role", "password", "removed", "file open to others", "file away"])
def test_a_session_ends(people: People, ada: Browser, ends: str) -> None:
    assert people.file
    user = read_users(people.file)["Ada"]
    assert ada.reads
    match ends:
        case "idle":
            people.time_s += 3599
            assert ada.reads
            people.time_s += 3601
        case "role":
            people.change(replace(user, role="view"))
        case "password":
            people.change(replace(user, password=hashed_password("another password")))
        case "removed":
            people.file.write_text("users: []")
        case "file open to others":
            people.file.chmod(0o644)
        case "file away":
            people.file.unlink()
    assert not ada.reads
    assert ada.get("/runs").headers["location"] == "/login?to=%2Fruns"


def test_a_new_token_of_ones_programs_ends_no_session(people: People, ada: Browser) -> None:
    assert people.file
    people.change(replace(read_users(people.file)["Ada"], token=""))
    assert ada.reads


def test_pages_are_told_when_their_session_ends(people: People) -> None:
    session = people.console.sessions.sign_in(read_users(people.file)["Ada"], people.console.sessions.of(None))
    closed: list[str] = []
    session.at_end.add(lambda: closed.append("closed"))

    async def later() -> None:
        task = asyncio.create_task(people.console.sessions.end_in_time())
        await asyncio.sleep(0)
        assert closed == []
        task.cancel()
        people.time_s += 4000
        task = asyncio.create_task(people.console.sessions.end_in_time())
        await asyncio.sleep(0)
        task.cancel()

    asyncio.run(later())
    assert closed == ["closed"]
    assert session.operator is None


def test_a_socket_carries_nothing_more_from_a_user_who_was_signed_out(people: People) -> None:
    sessions = people.console.sessions
    user = read_users(people.file)["Ada"]
    session = sessions.sign_in(user, sessions.of(None))
    arrived: list[Any] = []

    async def page(scope: Any, receive: Any, send: Any) -> None:
        arrived.extend([await receive(), await receive(), await receive()])
        people.change(replace(user, role="view"))
        arrived.append(await receive())

    async def receive() -> dict[str, Any]:
        people.time_s += 3000
        return {"type": "websocket.receive", "text": '42["event",{}]'}

    async def send(_: Any) -> None: ...

    headers = [(b"host", b"127.0.0.1:8090"), (b"origin", HERE.encode()), (b"cookie", f"c={session.id}".encode())]
    scope = {"type": "websocket", "path": "/_nicegui_ws/", "headers": headers, "query_string": b""}
    people.time_s -= 3000
    asyncio.run(Guard(page, names_of("127.0.0.1", 8090), sessions, "c")(scope, receive, send))
    assert [message["type"] for message in arrived] == [*["websocket.receive"] * 3, "websocket.disconnect"]


def test_a_stream_of_events_ends_for_a_user_who_was_signed_out(people: People) -> None:
    sent: list[Any] = []
    user = read_users(people.file)["Ada"]

    async def events(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"first", "more_body": True})
        people.change(replace(user, token=""))
        await send({"type": "http.response.body", "body": b"second", "more_body": True})

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> dict[str, Any]:
        return {"type": "http.disconnect"}

    headers = [(b"host", b"127.0.0.1:8090"), (b"authorization", b"Bearer token of Ada")]
    scope = {"type": "http", "method": "GET", "path": "/api/events", "headers": headers, "query_string": b""}
    asyncio.run(Guard(events, names_of("127.0.0.1", 8090), people.console.sessions, "c")(scope, receive, send))
    assert [message.get("body") for message in sent] == [None, b"first", None]
    assert not sent[-1].get("more_body")


def test_a_program_is_named_by_its_token_and_the_console_s_token_is_none(people: People) -> None:
    program, body = people.browser(), {"procedure": "no_such"}
    for token in ("secret", "token of Nobody", ""):
        refused = program.send("POST", "/api/queue", json=body, headers={"Authorization": f"Bearer {token}"})
        assert refused.status_code == 401
    named = {"Authorization": "Bearer token of Bo", "X-Operator": "Ada"}
    assert program.get("/api/console", headers=named).status_code == 200
    assert program.get("/metrics", headers={"Authorization": "Bearer token of Cy"}).status_code == 200
    program.send("DELETE", "/api/queue/x", headers=named)
    (line,) = people.console.audit.read()
    assert (line["operator"], line["command"]) == ("Bo", "queue remove")


def test_a_cookie_alone_commands_nothing_by_the_api(ada: Browser) -> None:
    assert ada.send("DELETE", "/api/queue/x").status_code == 401


def test_the_token_in_the_address_opens_no_console_with_users(people: People) -> None:
    answer = people.browser().get("/runs?token=secret")
    assert (answer.status_code, answer.headers["location"]) == (303, "/login?to=%2Fruns")


def test_a_form_is_no_place_for_a_large_content(people: People) -> None:
    assert people.browser().send("POST", "/login", content=b"x" * 20_000).status_code == 413
    assert people.browser().sign_in("Ada", PASSWORD * 60).status_code == 403


def test_passwords_do_not_cross_a_network_in_the_clear(tmp_path: Path) -> None:
    with_users = Settings(tmp_path, users=tmp_path / "users.yaml")
    with pytest.raises(InputError, match="--tls-cert"):
        refuse_open_passwords(with_users, "192.168.1.4")
    refuse_open_passwords(with_users, "127.0.0.1")
    refuse_open_passwords(with_users, "::1")
    refuse_open_passwords(replace(with_users, tls=(tmp_path, tmp_path)), "192.168.1.4")
    refuse_open_passwords(Settings(tmp_path), "192.168.1.4")


def test_who_brings_the_token_states_a_name_once(tmp_path: Path) -> None:
    people = People.at(tmp_path, users=False)
    browser = people.browser()
    opened = browser.get("/runs?token=secret&text=a")
    assert (opened.status_code, opened.headers["location"]) == (303, "/name?to=%2Fruns%3Ftext%3Da")
    form = browser.get(opened.headers["location"])
    assert "Your name" in form.text
    assert browser.send("POST", "/name", data={"name": " \u202e ", "to": "/runs"}).status_code == 422
    stated = browser.send("POST", "/name", data={"name": " Ada  L. ", "to": "/runs?text=a"})
    assert (stated.status_code, stated.headers["location"]) == (303, "/runs?text=a")
    session = people.console.sessions.of(browser.client.cookies["cellctl_console_8090"])
    assert session.operator
    assert session.operator.name == "Ada L."
    assert browser.get("/runs?token=secret").headers["location"] == "/runs"
    assert browser.get("/name?to=/runs").headers["location"] == "/runs"
    assert browser.get("/login?to=/runs").headers["location"] == "/runs"


def test_a_browser_without_the_token_states_no_name_and_reads(tmp_path: Path) -> None:
    people = People.at(tmp_path, users=False)
    browser = people.browser()
    assert browser.get("/name").headers["location"] == "/"
    browser.send("POST", "/name", data={"name": "Ada"})
    assert all(session.operator is None for session in people.console.sessions._known.values())
    assert browser.reads


def test_the_token_gives_the_browser_another_id(tmp_path: Path) -> None:
    browser = People.at(tmp_path, users=False).browser()
    before, opened = cookie(browser.get("/name")), cookie(browser.get("/?token=secret"))
    assert before != opened
