"""Parameters of a fit, one number each: name in files, unit, group, and wording for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Self, TypeAlias, final

from cellctl.kinematics import SerialChain

Group: TypeAlias = str
"""Parameters that are freed or held together: base, tool, zeros, links, points, datums, or an effect's own group."""


@final
@dataclass(frozen=True, slots=True)
class Unit:
    """A unit as in files, the unit shown to people, and the factor between them."""

    name: str
    shown: str
    factor: float = 1.0


MM = Unit("mm", "mm")
RAD = Unit("rad", "°", math.degrees(1.0))


@final
@dataclass(frozen=True, slots=True)
class Phrase:
    """How several parameters of a kind are named together: `one` or `many`, where `{}` is replaced by the items.

    part: position among the phrases of one group.
    """

    one: str
    many: str
    part: int = 0

    @classmethod
    def of(cls, words: str, carrier: str, part: int = 0) -> Self:
        """`backlash`, `joint`: backlash of joint 2, backlash of joints 2, 3."""
        return cls(f"{words} of {carrier} {{}}", f"{words} of {carrier}s {{}}", part)

    def of_items(self, items: Sequence[str]) -> str:
        """The words for these items, each once."""
        distinct = list(dict.fromkeys(items))
        return (self.one if len(distinct) == 1 else self.many).format(", ".join(distinct))


@final
@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a fit.

    name: as in files, unique in the fit. unit; group: freed and held together. label: as a metrologist writes it
    (`θ2`, `tool X`). phrase, item: how it is named together with others of its kind. joint: from 1; 0 where it belongs
    to none. session: its own session; empty for the first session's and the robot's. axis: of a frame, x y z a b c.
    column: of a link table (`theta`, `d`, …). owner: its fixed point or datum. band: the set with which its prior is
    scaled, where that is smaller than its group.
    """

    name: str
    unit: Unit
    group: Group
    label: str
    phrase: Phrase
    item: str = ""
    joint: int = 0
    session: str = ""
    axis: str = ""
    column: str = ""
    owner: str = ""
    band: str = ""

    @property
    def turns(self) -> bool:
        """Whether it is an angle, rad."""
        return self.unit is RAD

    @property
    def scaled_with(self) -> str:
        """The set with which its prior is scaled: its band, or its group."""
        return self.band or self.group

    @property
    def of_the_arm(self) -> bool:
        """Whether it belongs to a link or an axis, not to tool, base, an effect or a point."""
        return self.group in ARM

    def in_session(self, session: str) -> Parameter:
        """The same parameter of base or tool, in its own session: `base_x@NAME`."""
        where = f" in session {session}"
        phrase = replace(self.phrase, one=self.phrase.one + where, many=self.phrase.many + where)
        return replace(
            self, name=f"{self.name}@{session}", label=f"{self.label}, {session}", phrase=phrase, session=session
        )


ARM: frozenset[Group] = frozenset({"zeros", "links"})
FRAMES: frozenset[Group] = frozenset({"base", "tool"})

_GREEK = {"theta": "θ", "alpha": "α", "beta": "β"}
_AXES = {"turn": ("tilt", "tilt of axis {} about its"), "slide": ("place", "place of axis {} along its")}
_TURNED = {"a": "Z", "b": "Y", "c": "X"}


def of_chain(chain: SerialChain) -> tuple[Parameter, ...]:
    """The parameters (P,) of a chain, in its order. Only this function reads a chain's names."""
    units = (RAD if turns else MM for turns in chain.parameter_turns)
    zeros = {f"{'d' if slides else 'theta'}{number}" for number, slides in enumerate(chain.prismatic.tolist(), 1)}
    return tuple(_of_chain(name, unit, name in zeros) for name, unit in zip(chain.parameters, units, strict=True))


@cache
def _of_chain(name: str, unit: Unit, is_zero: bool) -> Parameter:
    kind, _, axis = name.partition("_")
    if kind in FRAMES:
        return _of_frame(name, unit, kind, axis)
    if kind in _AXES:
        number, (word, phrase) = axis[1:], _AXES[kind]
        words = f"{phrase.format(number)} {{}}"
        label = f"axis {number} {word} {axis[0]}"
        return Parameter(name, unit, "links", label, Phrase(words, words, 1), axis[0], int(number))
    letters = name.rstrip("0123456789")
    number = name.removeprefix(letters)
    symbol = f"{_GREEK.get(letters, letters)}{number}"
    group = "zeros" if is_zero else "links"
    return Parameter(name, unit, group, symbol, Phrase(symbol, symbol), joint=int(number), column=letters)


def _of_frame(name: str, unit: Unit, frame: Group, axis: str) -> Parameter:
    turn = _TURNED.get(axis, "")
    words = f"{frame} rotation about {{}}" if turn else f"{frame} translation along {{}}"
    label = f"{frame} {axis.upper()}"
    return Parameter(name, unit, frame, label, Phrase(words, words, int(bool(turn))), turn or axis.upper(), axis=axis)


def of_point(name: str, *, plane: bool = False) -> list[Parameter]:
    """The three of a fixed point called `name`; of a plane those of its pole."""
    if plane:
        begin, owner, phrase = f"{name}_plane", f"plane {name}", Phrase("plane {}", "planes {}", 1)
    else:  # a sphere may be called `tool`; its `_x` must differ from the robot's own names
        begin = owner = f"point {name}" if name in FRAMES else name
        phrase = Phrase("centre of {}", "centres of {}")
    item = name if plane else begin
    return [
        Parameter(f"{begin}_{axis}", MM, "points", f"{owner} {axis.upper()}", phrase, item, axis=axis, owner=begin)
        for axis in "xyz"
    ]


def of_datum(name: str) -> Parameter:
    """The reading of the instrument `name` at length 0."""
    label, phrase = f"{name}_zero", Phrase("zero of {}", "zeros of {}")
    return Parameter(label, MM, "datums", label, phrase, name, owner=f"the zero {name}")
