"""Values and expressions of KRL, and the rules that read them by recursive descent over the tokens of a line."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias, TypeVar, final

from cellctl.files.spans import Span
from cellctl.krl._tokens import Token


@final
@dataclass(frozen=True, slots=True)
class Number:
    """A number with its sign: `-90`, `+5`, `.5`, `1.0E-3`, `'B100011'`, `'H23'`. `span` covers the sign."""

    span: Span
    value: float


@final
@dataclass(frozen=True, slots=True)
class Literal:
    """A constant that is not a number: `"text"`, `#BASE`, `TRUE`. text: as written."""

    span: Span
    text: str


@final
@dataclass(frozen=True, slots=True)
class Reference:
    """A variable, a component or an element of it: `XP1`, `FP1.TOOL_NO`, `BASE_DATA[2]`, `TXT[]`, `P[I].X`.

    name: its variable as written. path: components (as written, with a dot) and indices after the name.
    """

    span: Span
    name: str
    path: tuple[str | tuple[Expression | None, ...], ...] = ()

    @property
    def key(self) -> str | None:
        """`BASE_DATA[2]`, `FP1.TOOL_NO` in upper case without white space; None if an index is not a number."""
        return self.written.upper() if self.certain else None

    @property
    def certain(self) -> bool:
        """Whether all indices are numbers."""
        return all(isinstance(item, Number | None) for part in self.path if isinstance(part, tuple) for item in part)

    @property
    def written(self) -> str:
        """The name with components and indices, without white space; `?` for an index that is not a number."""
        return self.name + "".join(part if isinstance(part, str) else f"[{_indices(part)}]" for part in self.path)


@final
@dataclass(frozen=True, slots=True)
class Field:
    """One component of an aggregate: `X 100.0`. label: upper case, `POINT2[]` with its brackets."""

    span: Span
    label: str
    value: Expression


@final
@dataclass(frozen=True, slots=True)
class Aggregate:
    """A structure written out: `{X 1.0,Y 2.0}`, `{E6POS: X 1.0}`. type: upper case, empty where none is written."""

    span: Span
    type: str
    fields: tuple[Field, ...]

    def field(self, label: str) -> Expression | None:
        """The value of the first component with this label (upper case)."""
        return next((field.value for field in self.fields if field.label == label), None)


@final
@dataclass(frozen=True, slots=True)
class Call:
    """A function or subprogram with its arguments; None for one left out: `SVEL_CP(0.1, , LCPDAT1)`."""

    span: Span
    name: str
    arguments: tuple[Expression | None, ...]


@final
@dataclass(frozen=True, slots=True)
class Operation:
    """Operands with operators before or between them, not evaluated: `XP1:OFFSET`, `XP1.Z+10`, `NOT $IN[1]`."""

    span: Span
    operators: tuple[str, ...]
    operands: tuple[Expression, ...]


Expression: TypeAlias = Number | Literal | Reference | Aggregate | Call | Operation


def _indices(items: tuple[Expression | None, ...]) -> str:
    texts = (f"{item.value:g}" if isinstance(item, Number) else "?" if item else "" for item in items)
    return ",".join(texts)


def references(expression: Expression | None) -> Iterator[Reference]:
    """All variables in an expression, also those of indices and arguments."""
    if isinstance(expression, Reference):
        yield expression
    for part in _parts(expression):
        yield from references(part)


def calls(expression: Expression | None) -> Iterator[Call]:
    """All calls in an expression, also those in arguments."""
    if isinstance(expression, Call):
        yield expression
    for part in _parts(expression):
        yield from calls(part)


def _parts(expression: Expression | None) -> list[Expression | None]:
    match expression:
        case Reference():
            return [item for part in expression.path if isinstance(part, tuple) for item in part]
        case Aggregate():
            return [field.value for field in expression.fields]
        case Call():
            return list(expression.arguments)
        case Operation():
            return list(expression.operands)
        case _:
            return []


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
