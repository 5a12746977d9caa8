"""`/login` and `/name`: plain forms, without the scripts of the pages, so that nobody needs these before signing in."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path
from typing import Annotated, Final

from fastapi import APIRouter, Form, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from jinja2 import Environment
from markupsafe import Markup, escape

from cellctl.console.guarding import SIGN_IN, STATE_NAME, change_session, nonce_of, session_of
from cellctl.console.sessions import MustWait, operator_named
from cellctl.console.shared import console
from cellctl.console.users import LONGEST_NAME, LONGEST_PASSWORD, User, plain_name
from cellctl.engine import Operator

router = APIRouter(tags=["console"], include_in_schema=False)

_STYLE = Markup((Path(__file__).parent / "console.css").read_text(encoding="utf-8"))
_LOOK = Markup(
    'const look = localStorage.getItem("cellctl-look");'
    'const dark = look ? look === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;'
    'document.body.classList.toggle("body--dark", dark);'
)
_PAGE: Final = Environment(autoescape=True).from_string(
    """<!doctype html>
<html lang="en-GB">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }} · cellctl</title><style nonce="{{ nonce }}">{{ style }}</style></head>
<body><script nonce="{{ nonce }}">{{ look }}</script>
<main class="page entry"><p class="name">cellctl</p><h1>{{ title }}</h1><p class="note">{{ note }}</p>
{% if problem %}<p class="problems" role="alert" id="problem">{{ problem }}</p>{% endif %}
<form method="post" action="{{ action }}"><input type="hidden" name="to" value="{{ to }}">
{% for field in fields %}<label for="{{ field.name }}">{{ field.label }}</label>
<input id="{{ field.name }}" name="{{ field.name }}" type="{{ field.type }}" value="{{ field.value }}"
 autocomplete="{{ field.autocomplete }}"
 maxlength="{{ field.longest }}" autocapitalize="none" spellcheck="false" required
 {% if problem %}aria-describedby="problem"{% endif %}>
{% endfor %}<button class="command important">{{ button }}</button></form></main></body></html>
"""
)
_NAME = {"name": "name", "label": "Your name", "type": "text", "longest": LONGEST_NAME}
_PASSWORD = {
    "name": "password",
    "label": "Password",
    "type": "password",
    "longest": LONGEST_PASSWORD,
    "autocomplete": "current-password",
}
_WRONG = "Name or password is wrong."


@router.get(SIGN_IN)
async def sign_in_form(request: Request, to: str = "/") -> Response:
    """The form to sign in; who is signed in goes on."""
    if console().sessions.users is None or session_of(request.scope).user is not None:
        return RedirectResponse(_own_address(to), 303)
    if request.headers.get("sec-fetch-site") in ("cross-site", "same-site"):
        # the browser followed a link of another site, and kept its cookie (Strict) to itself: it asks again from here
        there = escape(_own_address(to))
        return HTMLResponse(f'<meta http-equiv="refresh" content="0; url={there}"><title>cellctl</title>')
    return _sign_in_page(request, to)


@router.post(SIGN_IN)
async def sign_in(
    request: Request,
    name: Annotated[str, Form()] = "",
    password: Annotated[str, Form()] = "",
    to: Annotated[str, Form()] = "/",
) -> Response:
    """Sign in with name and password; the same answer to an unknown name and to a wrong password."""
    sessions, address = console().sessions, request.client.host if request.client else ""
    if sessions.users is None:
        return RedirectResponse(_own_address(to), 303)
    known = plain_name(name)
    try:
        user = await sessions.user_with(known, password, address)
    except MustWait as wait:
        left = math.ceil(wait.left_s)
        problem = f"There were too many wrong tries. Try again in {left} s."
        return _sign_in_page(request, to, name, problem, 429, {"retry-after": str(left)})
    await _record(user, known if known in sessions.users.users else "", address)
    if user is None:
        return _sign_in_page(request, to, name, _WRONG, 403)
    change_session(request.scope, sessions.sign_in(user, session_of(request.scope)))
    return RedirectResponse(_own_address(to), 303)


@router.get(STATE_NAME)
async def name_form(request: Request, to: str = "/") -> Response:
    """The form for the name of who has brought the token; anybody else goes on, and reads."""
    session = session_of(request.scope)
    if not session.with_token or session.operator is not None:
        return RedirectResponse(_own_address(to), 303)
    return _name_page(request, to)


@router.post(STATE_NAME)
async def state_name(request: Request, name: Annotated[str, Form()] = "", to: Annotated[str, Form()] = "/") -> Response:
    """State the name that the commands from this browser bear."""
    session = session_of(request.scope)
    if session.with_token and not console().sessions.open(session, "", name):
        return _name_page(request, to, "This is no name: give one letter or more.", 422)
    return RedirectResponse(_own_address(to), 303)


async def _record(user: User | None, name: str, address: str) -> None:
    """Record a try in the audit log. name: empty for one that no user has, for it may be a password by mistake."""
    host = operator_named("").host
    audit, who = console().audit, Operator(name or "unknown", host, "console")
    number = await asyncio.to_thread(audit.asked, who, "sign in", name, {"address": address})
    await asyncio.to_thread(audit.ended, number, "" if user else "name or password is wrong")


def _sign_in_page(
    request: Request,
    to: str,
    name: str = "",
    problem: str = "",
    status: int = 200,
    headers: dict[str, str] | None = None,
) -> HTMLResponse:
    note = "Commands bear your name in the audit log. The emergency stop of the cell works without this computer."
    fields = [{**_NAME, "label": "Name", "autocomplete": "username", "value": name}, _PASSWORD]
    shown = {"title": "Sign in", "note": note, "action": SIGN_IN, "fields": fields, "button": "Sign in"}
    return _page(request, {**shown, "to": to, "problem": problem}, status, headers)


def _name_page(request: Request, to: str, problem: str = "", status: int = 200) -> HTMLResponse:
    note = "Each command from this browser bears it in the record. You are asked once."
    fields = [{**_NAME, "autocomplete": "off"}]
    shown = {"title": "Who are you?", "note": note, "action": STATE_NAME, "fields": fields, "button": "Go on"}
    return _page(request, {**shown, "to": to, "problem": problem}, status)


def _page(
    request: Request, shown: dict[str, object], status: int, headers: dict[str, str] | None = None
) -> HTMLResponse:
    nonce = nonce_of(request.scope)
    content = _PAGE.render(**shown, nonce=nonce, style=_STYLE, look=_LOOK)
    return HTMLResponse(content, status, {"cache-control": "no-store", **(headers or {})})


def _own_address(to: str) -> str:
    """An address of this console; what may name another site is its first page."""
    is_own = to.startswith("/") and to[1:2] not in ("/", "\\") and to.isprintable()
    return to if is_own else "/"
