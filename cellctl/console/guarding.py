"""Guards of every request: Host, Origin, who asks, size, headers.

Sources: OWASP Cross-Site Request Forgery Prevention ("Verifying Origin With Standard Headers"); RFC 6265bis (SameSite).
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any, final
from urllib.parse import parse_qs, urlencode, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cellctl.console.sessions import Session, Sessions

LARGEST_BODY = 20_000_000
"""Bytes of a request's body; a data set of 20 MB has some 100 000 rows."""

LARGEST_FORM = 10_000
"""Bytes of a name and a password, which anybody may send."""

NO_TOKEN = "this command needs the console's token"
NO_USER = "only a user of this console may do this"

SIGN_IN, STATE_NAME = "/login", "/name"
"""Where a user signs in, and where who has brought the token states a name."""

_SESSION = "cellctl.session"
_NONCE = "cellctl.nonce"
_USED = re.compile(r'42\d*\["event"')
"""A socket's message that somebody did something on the page (Socket.IO: packet 4, event 2)."""
_OWN = ("none", "same-origin")
"""Sec-Fetch-Site of requests by the console's own pages and by the address bar."""

_CONTENT = (
    "default-src 'self'; script-src 'self' 'nonce-{nonce}' 'unsafe-eval'; style-src 'self' 'nonce-{nonce}'; "
    "style-src-attr 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; "
    "worker-src 'self' blob:; frame-ancestors 'self'; form-action 'self'; base-uri 'self'; object-src 'none'"
)
"""Scripts and styles of a page have the nonce of its request. NiceGUI evaluates handlers and Vue's templates from text
("unsafe-eval"), and its elements have style attributes.
"""

_HEADERS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "x-frame-options": "SAMEORIGIN",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-cache",
}


def session_of(scope: Mapping[str, Any]) -> Session:
    """The session of the browser that sent this request."""
    found = scope[_SESSION]
    assert isinstance(found, Session)
    return found


def change_session(scope: MutableMapping[str, Any], session: Session) -> None:
    """Give the browser that sent this request another session: the answer tells it the id."""
    scope[_SESSION] = session


def nonce_of(scope: Mapping[str, Any]) -> str:
    """The nonce of the scripts and styles of this request's page; empty without a guard."""
    return str(scope.get(_NONCE, ""))


_PORTS = {"http": 80, "https": 443}
"""Ports that an address of this scheme leaves out."""


def names_of(host: str, port: int, scheme: str = "http") -> frozenset[str]:
    """The values of the header Host that address a console at `host` and `port`, in lower case."""
    hosts = {host, "localhost", "127.0.0.1", "[::1]"} if host in ("127.0.0.1", "localhost", "::1") else {host}
    names = {f"[{name}]" if ":" in name and not name.startswith("[") else name for name in hosts}
    return frozenset(f"{name}:{port}".lower() for name in names) | (
        frozenset(names) if port == _PORTS[scheme] else frozenset()
    )


@final
@dataclass(frozen=True, slots=True)
class Guard:
    """Passes a request on if it addresses this console by one of `names` and does not come from another site."""

    app: ASGIApp
    names: frozenset[str]
    sessions: Sessions
    cookie: str
    largest_body: int = LARGEST_BODY
    scheme: str = "http"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse: 421 wrong host, 401 nobody who may, 403 another site, 413 too large."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if refusal := self._misplaced(scope, headers):
            await _refuse(scope, receive, send, *refusal)
            return
        scope[_SESSION] = session = self.sessions.of(_cookie(headers, self.cookie), keep=_is_page(scope))
        if refusal := self._of_nobody(scope, headers, session) or self._too_long(scope, headers):
            await _refuse(scope, receive, send, *refusal)
            return
        if scope["type"] == "websocket":
            await self.app(scope, self._while_signed_in(session, receive), send)
            return
        scope[_NONCE] = secrets.token_urlsafe(16)
        answer = self._answering(scope, headers, send)
        if (redirect := self._elsewhere(scope, session)) is not None:
            await redirect(scope, receive, answer)
            return
        if not scope["path"].startswith("/_nicegui"):  # what a page loads by itself
            self.sessions.use(session)
        await _bounded(self.app, scope, receive, answer, self._largest(scope))

    def _largest(self, scope: Scope) -> int:
        return LARGEST_FORM if scope["path"] in (SIGN_IN, STATE_NAME) else self.largest_body

    def _misplaced(self, scope: Scope, headers: Headers) -> tuple[int, str, str] | None:
        host = headers.get("host", "").lower()
        if host not in self.names:
            return 421, "this console is not known by that name", f"open {self.scheme}://{sorted(self.names)[0]}"
        if self._of_another_site(scope, headers):
            return 403, "a page of another site sent this request", "use the console's own pages"
        return None

    def _too_long(self, scope: Scope, headers: Headers) -> tuple[int, str, str] | None:
        length = headers.get("content-length", "0")
        if length.isdecimal() and int(length) <= self._largest(scope):
            return None
        return _too_large(self._largest(scope))

    def _of_nobody(self, scope: Scope, headers: Headers, session: Session) -> tuple[int, str, str] | None:
        """A command of the API without a token; what nobody may read who is not signed in."""
        if _commands(scope):
            if self.sessions.of_program(_bearer(headers)):
                return None
            if self.sessions.users is None:
                return 401, NO_TOKEN, "send `Authorization: Bearer TOKEN`"
            return 401, NO_USER, "send `Authorization: Bearer TOKEN`, a token of `cellctl users token`"
        if _is_page(scope) or self._may_read(session, headers):
            return None
        return 401, NO_USER, f"sign in at {SIGN_IN}, or send `Authorization: Bearer TOKEN`"

    def _may_read(self, session: Session, headers: Headers) -> bool:
        return self.sessions.may_read(session) or self.sessions.of_program(_bearer(headers)) is not None

    def _while_signed_in(self, session: Session, receive: Receive) -> Receive:
        """`receive` of a page's socket, which ends when the page's user is signed out."""

        async def received() -> Message:
            message = await receive()
            if message["type"] == "websocket.receive":
                if not self.sessions.may_read(session):
                    return {"type": "websocket.disconnect", "code": 1008}
                if _USED.match(message.get("text") or ""):
                    self.sessions.use(session)
            return message

        return received

    def _of_another_site(self, scope: Scope, headers: Headers) -> bool:
        """Another site may link to the console's pages; it may not send, frame, embed, or read anything of it."""
        origin = headers.get("origin")
        if origin is not None and _place(origin) not in self.names:
            return True
        if headers.get("sec-fetch-site", "none") in _OWN:
            return False
        shown = (headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest")) == ("navigate", "document")
        return not (shown and scope["type"] == "http" and scope["method"] == "GET")

    def _elsewhere(self, scope: Scope, session: Session) -> ASGIApp | None:
        """Where a browser goes before it gets a page: who is not signed in to `SIGN_IN`; who opens the address with
        `?token=` to the same without it, by `STATE_NAME` if no name is stated yet.
        """
        path, query = scope["path"], parse_qs(scope["query_string"].decode(errors="replace"))
        if not _is_page(scope) or path == SIGN_IN:
            return None
        if not self.sessions.may_read(session):
            if scope["method"] not in ("GET", "HEAD"):
                return _failure(401, NO_USER, f"sign in at {SIGN_IN}")
            query.pop("token", None)
            return _to_form(SIGN_IN, _address(path, query))
        if "token" not in query or scope["method"] != "GET":
            return None
        token = query.pop("token")[0]
        if self.sessions.users is not None:
            return _to(_address(path, query))
        opened = self.sessions.invited(session, token)
        if opened is None:
            cure = "copy the address that the console printed at its start"
            return _failure(403, "the token in the address is wrong", cure)
        change_session(scope, opened)
        there = _address(path, query)
        return _to(there) if opened.operator else _to_form(STATE_NAME, there)

    def _answering(self, scope: Scope, headers: Headers, send: Send) -> Send:
        came_with, is_stream, is_over = _cookie(headers, self.cookie), False, False

        def is_told(session: Session) -> bool:
            # a browser that follows a link of another site keeps its cookie to itself (Strict): do not replace that one
            linked = headers.get("sec-fetch-site", "none") not in _OWN and session.operator is None
            kept = self.sessions.users is None or session.user is not None
            return _is_page(scope) and kept and came_with != session.id and not linked

        async def answer(message: Message) -> None:
            nonlocal is_stream, is_over
            if is_over:
                return
            if is_stream and message.get("more_body") and not self._may_read(session_of(scope), headers):
                is_over = (
                    True  # a user was signed out who reads the events; the server then ends the application's part
                )
                await send({"type": "http.response.body"})
                return
            if message["type"] == "http.response.start":
                out = MutableHeaders(scope=message)
                is_stream = "content-length" not in out
                policy = _CONTENT.format(nonce=nonce_of(scope))
                for name, value in {**_HEADERS, "content-security-policy": policy}.items():
                    if name not in out:
                        out[name] = value
                if is_told(session := session_of(scope)):
                    secure = "; Secure" if self.scheme == "https" else ""
                    out.append("set-cookie", f"{self.cookie}={session.id}; Path=/; HttpOnly; SameSite=Strict{secure}")
            await send(message)

        return answer


def _address(path: str, query: Mapping[str, list[str]]) -> str:
    """An address of this console: one slash at its beginning, so that it names no other site."""
    left = urlencode(query, doseq=True)
    return f"/{path.lstrip('/')}{'?' if left else ''}{left}"


def _to(address: str) -> ASGIApp:
    return RedirectResponse(address, 303)


def _to_form(form: str, then: str) -> ASGIApp:
    return _to(f"{form}?{urlencode({'to': then})}")


def _is_page(scope: Scope) -> bool:
    """Whether a page is asked for: not a route of the API, figures for a monitor, a file or connection of the pages."""
    return scope["type"] == "http" and not scope["path"].startswith(("/api/", "/_nicegui", "/metrics"))


def _commands(scope: Scope) -> bool:
    """Whether the API is asked to do something: its content is not read without the token."""
    return (
        scope["type"] == "http"
        and scope["path"].startswith("/api/")
        and scope["method"] not in ("GET", "HEAD", "OPTIONS")
    )


def _bearer(headers: Headers) -> str:
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


def _place(origin: str) -> str:
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""


async def _bounded(app: ASGIApp, scope: Scope, receive: Receive, send: Send, largest: int) -> None:
    """Pass the request on; where its body gets larger than stated, the app sees a lost client and this answers 413."""
    seen = 0

    async def counted() -> Message:
        nonlocal seen
        message = await receive()
        seen += len(message.get("body", b""))
        return {"type": "http.disconnect"} if seen > largest else message

    async def sent(message: Message) -> None:
        if seen <= largest:
            await send(message)

    try:
        await app(scope, counted, sent)
    except Exception:
        if seen <= largest:
            raise
    if seen > largest:
        await _refuse(scope, receive, send, *_too_large(largest))


def _too_large(largest: int) -> tuple[int, str, str]:
    what = f"the upload is larger than {largest / 1e6:g} MB"
    return 413, what, "reduce it, or fit it on the command line, which reads files of any size"


def _cookie(headers: Headers, name: str) -> str | None:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(name)
    except CookieError:
        return None
    return found.value if found else None


def _failure(status: int, what: str, cure: str) -> JSONResponse:
    headers = {"www-authenticate": "Bearer"} if status == 401 else None
    return JSONResponse({"what": what, "cure": cure, "problems": []}, status, headers)


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, what: str, cure: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": what})
        return
    await _failure(status, what, cure)(scope, receive, send)
