"""Requests that the console refuses: another host name, another site, a wrong token, a body that is too large."""

from __future__ import annotations

import httpx
import pytest
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.types import Receive, Scope, Send

from cellctl.console.guarding import Guard, names_of, session_of
from cellctl.console.sessions import Sessions, operator_named

HERE = "http://127.0.0.1:8090"


async def _echo(scope: Scope, receive: Receive, send: Send) -> None:
    body = await Request(scope, receive).body()
    operator = session_of(scope).operator
    await PlainTextResponse(f"{len(body)} bytes, {operator.name if operator else 'reader'}")(scope, receive, send)


def _client(sessions: Sessions | None = None, **options) -> httpx.AsyncClient:
    guard = Guard(_echo, names_of("127.0.0.1", 8090), sessions or Sessions("secret"), "session", **options)
    return httpx.AsyncClient(transport=httpx.ASGITransport(guard), base_url=HERE)


async def _answer(method: str, path: str = "/", *, options=None, **more) -> httpx.Response:
    async with _client(**(options or {})) as client:
        return await client.request(method, path, **more)


def run(work):
    import asyncio

    return asyncio.run(work)


@pytest.mark.parametrize(
    "host", ["evil.example:8090", "127.0.0.1", "127.0.0.1:9999", "localhost.evil.example:8090", ""]
)
def test_a_page_under_another_host_name_cannot_read_the_console(host: str) -> None:
    assert run(_answer("GET", headers={"host": host})).status_code == 421


@pytest.mark.parametrize("host", ["127.0.0.1:8090", "localhost:8090", "LOCALHOST:8090", "[::1]:8090"])
def test_the_console_answers_under_the_names_of_the_loopback_address(host: str) -> None:
    assert run(_answer("GET", headers={"host": host})).text == "0 bytes, reader"


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:9999", "http://127.0.0.1:8090.evil.example"]
)
def test_a_page_of_another_site_cannot_send_a_command(origin: str) -> None:
    refused = run(_answer("POST", headers={"origin": origin}))
    assert refused.status_code == 403
    assert "another site" in refused.json()["what"]


def test_a_browser_that_calls_the_request_cross_site_is_believed() -> None:
    assert run(_answer("POST", headers={"sec-fetch-site": "cross-site"})).status_code == 403


def test_own_pages_and_programs_without_origin_may_send() -> None:
    assert run(_answer("POST", content=b"abc", headers={"origin": HERE})).text == "3 bytes, reader"
    assert run(_answer("POST", content=b"abc")).text == "3 bytes, reader"


def test_a_socket_that_a_page_of_another_site_opens_is_closed() -> None:
    sent = []

    async def connect(origin: bytes) -> None:
        guard = Guard(_echo, names_of("127.0.0.1", 8090), Sessions("secret"), "session")
        headers = [(b"host", b"127.0.0.1:8090"), (b"origin", origin)]

        async def receive():
            return {"type": "websocket.connect"}

        async def send(message):
            sent.append(message)

        scope = {"type": "websocket", "path": "/", "headers": headers, "query_string": b""}
        await guard(scope, receive, send)

    run(connect(b"http://evil.example"))
    assert sent == [{"type": "websocket.close", "code": 1008, "reason": "a page of another site sent this request"}]


@pytest.mark.parametrize("stated", [True, False], ids=["stated length", "stream of unknown length"])
def test_a_body_that_is_too_large_is_refused_with_the_limit(stated: bool) -> None:
    async def pieces():
        for _ in range(30):
            yield b"x" * 100_000

    content = b"x" * 3_000_000 if stated else pieces()
    refused = run(_answer("POST", content=content, options={"largest_body": 2_000_000}))
    assert refused.status_code == 413
    assert "2 MB" in refused.json()["what"]


def test_the_token_in_the_address_disappears_from_it_and_opens_this_browser_once_it_has_stated_a_name() -> None:
    async def work():
        async with _client(sessions=sessions) as client:
            opened = await client.get("/runs?token=secret&search=a")
            nameless, session = await client.get("/runs"), next(iter(sessions._known.values()))
            assert not sessions.open(session, "", " ")
            assert sessions.open(session, "", "Ada")
            return opened, nameless.text, (await client.get("/runs")).text, (await _answer("GET", "/runs")).text

    sessions = Sessions("secret")
    opened, nameless, mine, of_another = run(work())
    assert (opened.status_code, opened.headers["location"]) == (303, "/name?to=%2Fruns%3Fsearch%3Da")
    assert "HttpOnly" in opened.headers["set-cookie"]
    assert "SameSite=Strict" in opened.headers["set-cookie"]
    assert "reader" in nameless
    assert "Ada" in mine
    assert "reader" in of_another


def test_a_wrong_token_in_the_address_says_where_the_right_one_is() -> None:
    refused = run(_answer("GET", "/?token=wrong"))
    assert refused.status_code == 403
    assert "printed" in refused.json()["cure"]


def test_answers_forbid_other_sites_to_frame_the_console_and_pages_to_load_from_elsewhere() -> None:
    policy = run(_answer("GET")).headers["content-security-policy"]
    assert "frame-ancestors 'self'" in policy
    assert "default-src 'self'" in policy


def test_a_page_runs_no_inline_script_but_its_own() -> None:
    first, second = (run(_answer("GET")).headers["content-security-policy"] for _ in range(2))
    scripts = next(rule for rule in first.split("; ") if rule.startswith("script-src"))
    assert "'nonce-" in scripts
    assert "'unsafe-inline'" not in scripts
    assert first != second


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://127.0.0.1:9999"},
        {"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors", "sec-fetch-dest": "image"},
        {"sec-fetch-site": "same-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "iframe"},
    ],
    ids=["program at another port", "picture", "frame"],
)
def test_another_site_cannot_read_or_embed_what_needs_no_token(headers: dict[str, str]) -> None:
    assert run(_answer("GET", "/api/runs", headers=headers)).status_code == 403


def test_a_link_from_another_site_opens_a_page_and_leaves_the_operator_in_command() -> None:
    linked = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
    opened = run(_answer("GET", "/runs", headers=linked))
    assert opened.text.endswith("reader")
    assert "set-cookie" not in opened.headers  # it would replace the operator's, which the browser did not send


def test_programs_that_ask_the_api_again_and_again_do_not_push_out_a_browser() -> None:
    async def work() -> httpx.Response:
        async with _client() as browser:
            await browser.get("/runs")
            for _ in range(1100):
                await browser.get("/api/runs", headers={"cookie": "session=unknown"})
            return await browser.get("/runs")

    assert "set-cookie" not in run(work()).headers


def test_an_address_with_a_token_leads_to_no_other_site() -> None:
    assert (
        run(_answer("GET", f"{HERE}//evil.example/?token=secret")).headers["location"] == "/name?to=%2Fevil.example%2F"
    )


@pytest.mark.parametrize("length", ["-1", "1e9", "x"])
def test_a_length_that_is_no_number_is_refused(length: str) -> None:
    assert run(_answer("POST", content=b"", headers={"content-length": length})).status_code == 413


def test_what_is_not_printable_in_an_operators_name_reaches_no_log() -> None:
    assert operator_named("Ada\x1b[2J\u202e\r\nx: y").name == "Ada[2J x: y"
