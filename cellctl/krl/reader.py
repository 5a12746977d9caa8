"""Recursive descent over the tokens of one line: the rules for expressions. `grammar` has the rules for statements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar, final

from cellctl.krl.expressions import Aggregate, Call, Expression, Field, Literal, Number, Operation, Reference
from cellctl.krl.tokens import Span, Token

Item = TypeVar("Item")

_BEFORE = frozenset({"+", "-", "NOT", "B_NOT"})
_BETWEEN = frozenset(
    {"+", "-", "*", "/", ":", "==", "<>", "<", ">", "<=", ">=", "AND", "OR", "EXOR", "B_AND", "B_OR", "B_EXOR"}
    | {"DIV", "MOD"}
)
_DEEPEST = 40


@final
class NotUnderstood(Exception):
    """A line that the grammar does not cover, with the reason."""


@final
class Reader:
    """The tokens of one statement and the place reached. Each rule takes its tokens or raises NotUnderstood."""

    def __init__(self, tokens: Sequence[Token]) -> None:
        for token in tokens:
            if token.kind == "bad":
                what = "a text that does not end on this line" if token.text[0] == '"' else "no character of KRL"
                raise NotUnderstood(f"{token.text[:20]!r} is {what}")
        self._tokens = tokens
        self._at = 0
        self._depth = 0

    @property
    def token(self) -> Token | None:
        """The next token; None at the end."""
        return self._tokens[self._at] if self._at < len(self._tokens) else None

    @property
    def word(self) -> str:
        """The next token in upper case; empty at the end."""
        return self._tokens[self._at].word if self._at < len(self._tokens) else ""

    @property
    def following(self) -> str:
        """The token after the next; empty at the end."""
        return self._tokens[self._at + 1].text if self._at + 1 < len(self._tokens) else ""

    def kinds(self, *kinds: str) -> bool:
        """Whether the next tokens are of these kinds."""
        return [token.kind for token in self._tokens[self._at : self._at + len(kinds)]] == list(kinds)

    def take(self) -> Token:
        """The next token."""
        if self._at >= len(self._tokens):
            raise NotUnderstood("the line ends too early")
        self._at += 1
        return self._tokens[self._at - 1]

    def accept(self, *words: str) -> bool:
        """Take the next token if it is one of `words`."""
        found = self.word in words and self.token is not None and self.token.kind in ("name", "sign")
        self._at += found
        return found

    def expect(self, word: str) -> Token:
        """The next token, which is `word`."""
        if not self.accept(word):
            found = f", '{self.token.text}' found" if self.token else ": the line ends"
            raise NotUnderstood(f"'{word}' is missing{found}")
        return self._tokens[self._at - 1]

    def name(self) -> Token:
        """A name."""
        if not self.kinds("name"):
            raise NotUnderstood(f"a name is missing{f' before {self.word!r}' if self.word else ': the line ends'}")
        return self.take()

    def end(self) -> None:
        """The end of the line."""
        if self.token is not None:
            raise NotUnderstood(f"'{self.token.text}' is not understood here")

    def span_from(self, start: int) -> Span:
        """The place from `start` to the last token taken."""
        return Span(start, self._tokens[self._at - 1].span.end)

    def rest(self) -> list[Token]:
        """All tokens that are left; their brackets must match."""
        found = list(self._tokens[self._at :])
        self._at = len(self._tokens)
        open_: list[str] = []
        for token in found:
            if token.text in ("(", "[", "{"):
                open_.append(token.text)
            elif token.text in (")", "]", "}") and (not open_ or open_.pop() + token.text not in ("()", "[]", "{}")):
                raise NotUnderstood(f"'{token.text}' closes no bracket")
        if open_:
            raise NotUnderstood(f"'{open_[-1]}' is not closed")
        return found

    def listed(self, rule: Callable[[], Item], close: str) -> tuple[Item, ...]:
        """Items between commas, up to and with `close`."""
        found = [rule()]
        while self.accept(","):
            found.append(rule())
        self.expect(close)
        return tuple(found)

    def expression(self) -> Expression:
        """An operand, or operands with operators."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise NotUnderstood(f"brackets nested more than {_DEEPEST} deep")
        start = self.token.span.start if self.token else 0
        operators: list[str] = []
        operands = [self._operand(operators)]
        while self.word in _BETWEEN and self.token is not None:
            operators.append(self.take().word)
            operands.append(self._operand(operators))
        self._depth -= 1
        return Operation(self.span_from(start), tuple(operators), tuple(operands)) if operators else operands[0]

    def _operand(self, operators: list[str]) -> Expression:
        while self.word in _BEFORE and self.token is not None:
            sign = self.take()
            if sign.text in ("+", "-") and self.kinds("number"):
                digits = self.take()
                value = float(digits.text) * (-1.0 if sign.text == "-" else 1.0)
                return Number(Span(sign.span.start, digits.span.end), value)
            operators.append(sign.word)
        token = self.token
        if token is None:
            raise NotUnderstood("a value is missing: the line ends")
        match token.kind, token.text:
            case "number", _:
                return Number(self.take().span, float(token.text))
            case "bits", _:
                return Number(self.take().span, _bits(token.text))
            case "string" | "enum", _:
                return Literal(self.take().span, token.text)
            case "name", _:
                return self._named()
            case _, "{":
                return self.aggregate()
            case _, "(":
                self.take()
                inner = self.expression()
                self.expect(")")
                return inner
        raise NotUnderstood(f"a value is missing before '{token.text}'")

    def _named(self) -> Expression:
        token = self.token
        assert token is not None
        if token.word in ("TRUE", "FALSE"):
            return Literal(self.take().span, token.text)
        if self.following == "(":
            self._at += 2
            arguments = () if self.accept(")") else self.listed(lambda: self._optional(")"), ")")
            return Call(self.span_from(token.span.start), token.text, arguments)
        return self.reference()

    def reference(self) -> Reference:
        """A variable with its components and indices."""
        token = self.name()
        path: list[str | tuple[Expression | None, ...]] = []
        while self.word in (".", "["):
            if self.take().text == ".":
                path.append("." + self.name().text)
            else:
                path.append(self.listed(lambda: self._optional("]"), "]"))
        return Reference(self.span_from(token.span.start), token.text, tuple(path))

    def _optional(self, close: str) -> Expression | None:
        return None if self.word in (",", close) else self.expression()

    def aggregate(self) -> Aggregate:
        """A structure written out."""
        start = self.expect("{").span.start
        kind = ""
        if self.kinds("name") and self.following == ":":
            kind = self.take().word
            self.take()
        if self.token is None:
            raise NotUnderstood("'}' is missing: the line ends")
        fields = () if self.accept("}") else self.listed(self._field, "}")
        return Aggregate(self.span_from(start), kind, fields)

    def _field(self) -> Field:
        if not self.kinds("name"):
            found = f"'{self.token.text}'" if self.token else "the end of the line"
            raise NotUnderstood(f"{found} is not 'A1 12.5': KRL has decimal points, commas between the components")
        label = self.reference()
        if self.token is None or self.word in (",", "}"):
            raise NotUnderstood(f"'{label.name}' has no value")
        value = self.expression()
        return Field(self.span_from(label.span.start), label.written.upper(), value)


def _bits(text: str) -> float:
    """The value of `'B100011'` or `'HFF'`; as a float, infinite where it has none."""
    digits = "".join(text.strip("'").split())
    try:
        return float(int(digits[1:], 2 if digits[0] in "Bb" else 16))
    except OverflowError:
        return float("inf")
