"""Sessions of browsers, the token for commands, and guards of every request: Host, Origin, size, headers.

Sources: OWASP Cross-Site Request Forgery Prevention ("Verifying Origin With Standard Headers"); RFC 6265bis (SameSite).
"""

from __future__ import annotations

import getpass
import secrets
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Any, final
from urllib.parse import parse_qs, urlencode, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cellctl.engine import Operator

_MOST_SESSIONS = 1000


@final
@dataclass(slots=True)
class Session:
    """A browser. `operator`: who gives commands from it; None until the token was given."""

    id: str
    operator: Operator | None = None


@final
@dataclass(slots=True)
class Sessions:
    """The browsers of this console, in memory: they end with it. `token`: allows commands."""

    token: str
    _known: dict[str, Session] = field(default_factory=dict)

    def of(self, number: str | None, *, keep: bool = True) -> Session:
        """The session with this id; a new one for an unknown id. keep: the browser is told its id, and comes again."""
        known = self._known.get(number or "")
        if known is None:
            known = Session(secrets.token_urlsafe(24))
            if keep:
                self._known[known.id] = known
                self._forget()
        return known

    def _forget(self) -> None:
        """Forget the oldest session that was not opened for commands, or else the oldest, if there are too many."""
        if len(self._known) > _MOST_SESSIONS:
            oldest = min(self._known.values(), key=lambda session: session.operator is not None)
            del self._known[oldest.id]

    def allows(self, token: str) -> bool:
        """Whether `token` is the console's."""
        return secrets.compare_digest(token.encode(errors="replace"), self.token.encode())

    def open(self, session: Session, token: str, name: str = "") -> bool:
        """Allow commands from `session` as `name` (empty: the user of this process) if the token is right."""
        if not self.allows(token):
            return False
        session.operator = operator_named(name)
        return True


def operator_named(name: str) -> Operator:
    """An operator at the console; an empty name is the user of this process. What is not printable is left out."""
    plain = "".join(letter for letter in " ".join(name.split()) if letter.isprintable())
    return Operator(plain[:80].strip() or getpass.getuser(), socket.gethostname(), "console")


LARGEST_BODY = 20_000_000
"""Bytes of a request's body; a data set of 20 MB has some 100 000 rows."""

NO_TOKEN = "this command needs the console's token"

_SESSION = "cellctl.session"
_NONCE = "cellctl.nonce"
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
        """Answer, or refuse: 421 wrong host, 401 a command without the token, 403 another site, 413 too large."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        refusal = self._refusal(scope, headers)
        if refusal:
            await _refuse(scope, receive, send, *refusal)
            return
        scope[_SESSION] = session = self.sessions.of(_cookie(headers, self.cookie), keep=_is_page(scope))
        if scope["type"] == "websocket":
            await self.app(scope, receive, send)
            return
        scope[_NONCE] = secrets.token_urlsafe(16)
        answer = self._answering(scope, headers, session, send)
        if (redirect := self._with_token(scope, session)) is not None:
            await redirect(scope, receive, answer)
            return
        await _bounded(self.app, scope, receive, answer, self.largest_body)

    def _refusal(self, scope: Scope, headers: Headers) -> tuple[int, str, str] | None:
        host = headers.get("host", "").lower()
        if host not in self.names:
            return 421, "this console is not known by that name", f"open {self.scheme}://{sorted(self.names)[0]}"
        if self._of_another_site(scope, headers):
            return 403, "a page of another site sent this request", "use the console's own pages"
        if _commands(scope) and not self.sessions.allows(_bearer(headers)):
            return 401, NO_TOKEN, "send `Authorization: Bearer TOKEN`"
        length = headers.get("content-length", "0")
        if not length.isdecimal() or int(length) > self.largest_body:
            return _too_large(self.largest_body)
        return None

    def _of_another_site(self, scope: Scope, headers: Headers) -> bool:
        """Another site may link to the console's pages; it may not send, frame, embed, or read anything of it."""
        origin = headers.get("origin")
        if origin is not None and _place(origin) not in self.names:
            return True
        if headers.get("sec-fetch-site", "none") in _OWN:
            return False
        shown = (headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest")) == ("navigate", "document")
        return not (shown and scope["type"] == "http" and scope["method"] == "GET")

    def _with_token(self, scope: Scope, session: Session) -> ASGIApp | None:
        """For a page opened with `?token=`: the session is opened, and the address is shown without the token."""
        path, query = scope["path"], parse_qs(scope["query_string"].decode(errors="replace"))
        if "token" not in query or scope["method"] != "GET" or not _is_page(scope):
            return None
        if not self.sessions.open(session, query.pop("token")[0]):
            return _failure(
                403, "the token in the address is wrong", "copy the address that the console printed at its start"
            )
        left = urlencode(query, doseq=True)
        return RedirectResponse(f"/{path.lstrip('/')}{'?' if left else ''}{left}", 303)

    def _answering(self, scope: Scope, headers: Headers, session: Session, send: Send) -> Send:
        known = _cookie(headers, self.cookie) == session.id
        # a browser that follows a link of another site keeps its cookie to itself (Strict): do not replace that one
        linked = headers.get("sec-fetch-site", "none") not in _OWN and session.operator is None
        told = _is_page(scope) and not known and not linked

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                out = MutableHeaders(scope=message)
                policy = _CONTENT.format(nonce=nonce_of(scope))
                for name, value in {**_HEADERS, "content-security-policy": policy}.items():
                    if name not in out:
                        out[name] = value
                if told:
                    secure = "; Secure" if self.scheme == "https" else ""
                    out.append("set-cookie", f"{self.cookie}={session.id}; Path=/; HttpOnly; SameSite=Strict{secure}")
            await send(message)

        return answer


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
