"""How a program's paths interpolate the orientation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from cellctl.krl import Aggregate, Assignment, Call, Expression, KrlFile, Motion, Reference, Spline
from cellctl.krl import Literal as Constant

_COMPONENTS = {"$ORI_TYPE": "ORI_TYP", "$CIRC_TYPE": "CIRC_TYP"}
_DEFAULTS = {"$ORI_TYPE": "#VAR", "$CIRC_TYPE": "#BASE"}
UNKNOWN = "not certain"


@final
class Modes:
    """`$ORI_TYPE` and `$CIRC_TYPE` in force, from assignments and from the LDAT of the inline forms.

    data: files with the LDAT. Without any of these both are as after BAS(#INITMOV,0).
    """

    def __init__(self, data: Sequence[KrlFile]) -> None:
        self._data = data
        self._now = dict(_DEFAULTS)
        self._ldat: Expression | None = None
        self._block: tuple[Assignment, ...] = ()

    def assign(self, statement: Assignment) -> None:
        """An assignment of the program."""
        name = statement.target.written.upper()
        if name == "LDAT_ACT":
            self._ldat = statement.value
        elif name in self._now:
            self._now[name] = self._mode(statement.value, name)

    def call(self, call: Call) -> None:
        """A call of BAS."""
        command = call.arguments[0] if call.arguments else None
        name = command.text.upper() if isinstance(command, Constant) else ""
        if name == "#INITMOV":
            self._now = dict(_DEFAULTS)
        elif name == "#CP_PARAMS" and self._ldat is not None:
            self._now = {name: self._mode(self._ldat, name) for name in self._now}

    def spline(self, statement: Spline) -> None:
        """The begin or end of a spline block."""
        self._block = statement.settings

    def of(self, motion: Motion) -> tuple[str, str]:
        """`$ORI_TYPE` and `$CIRC_TYPE` of a motion."""
        here = dict(self._now)
        for setting in (*self._block, *motion.settings) if motion.spline else motion.settings:
            name = setting.target.written.upper()
            if name in here:
                here[name] = self._mode(setting.value, name)
        return here["$ORI_TYPE"], here["$CIRC_TYPE"]

    def _mode(self, value: Expression | None, name: str) -> str:
        """`#VAR` of a constant, of an LDAT, or of `SORI_TYP(LCPDAT1)`."""
        if isinstance(value, Call):
            return self._mode(value.arguments[0] if value.arguments else None, name)
        if isinstance(value, Reference):
            declared = (file.declared.get(value.name.upper()) for file in self._data)
            value = next((found for found in declared if found is not None), None)
        if isinstance(value, Aggregate):
            value = value.field(_COMPONENTS[name]) or Constant(value.span, _DEFAULTS[name])
        return value.text.upper().replace(" ", "") if isinstance(value, Constant) else UNKNOWN
