"""Folds and the pendant's inline forms: comments with a form, which the controller's editor writes and reads."""

from __future__ import annotations

import re

from cellctl.krl.statements import Comment, EndFold, Fold, InlineForm
from cellctl.krl.tokens import Token

_FOLD = re.compile(r";\s*FOLD\b\s*(?P<title>[^;]*)", re.IGNORECASE)
_END = re.compile(r";\s*ENDFOLD\b", re.IGNORECASE)
_FORM = re.compile(
    r"(?P<kind>PTP|SPTP|LIN|SLIN|SPL|(?P<circle>S?CIRC))\s+(?P<point>[\w$]+)(?(circle)\s+(?P<end>[\w$]+))"
    r"(?P<cont>\s+CONT)?\s+(?:VEL\s*=\s*(?P<velocity>[0-9.]+\s*(?:%|M/S))\s+)?(?P<data>(?!TOOL\[|BASE\[)\w+)?(?P<rest>.*)",
    re.IGNORECASE | re.DOTALL,
)
_FRAMES = re.compile(
    r"\b(?P<what>TOOL|BASE)\[\s*(?P<number>[0-9]{1,3})\s*\]\s*(?::(?P<name>.*?))?(?=\s*\bBASE\[|\s*\bTOOL\[|\s*$)",
    re.IGNORECASE | re.DOTALL,
)


def comment_statement(line: int, comment: Token) -> Comment | Fold | EndFold:
    """A comment as fold, end of a fold, or plain comment."""
    if _END.match(comment.text):
        return EndFold(line, comment.span)
    if found := _FOLD.match(comment.text):
        title = found["title"].strip()
        return Fold(line, comment.span, title, inline_form(title))
    return Comment(line, comment.span, comment.text[1:])


def inline_form(title: str) -> InlineForm | None:
    """The motion that a title shows; None without velocity, motion data and frame: `PTP to the table`."""
    found = _FORM.fullmatch(title)
    if found is None:
        return None
    frames = {frame["what"].upper(): frame for frame in _FRAMES.finditer(found["rest"])}
    if not (found["velocity"] or frames or "DAT" in (found["data"] or "").upper()):
        return None
    tool, base = frames.get("TOOL"), frames.get("BASE")
    return InlineForm(
        kind=found["kind"].upper(),
        points=(found["point"], *([found["end"]] if found["end"] else [])),
        approximated=found["cont"] is not None,
        velocity=found["velocity"] or "",
        data=found["data"] or "",
        tool=int(tool["number"]) if tool else None,
        tool_name=(tool["name"] or "").strip() if tool else "",
        base=int(base["number"]) if base else None,
        base_name=(base["name"] or "").strip() if base else "",
    )
