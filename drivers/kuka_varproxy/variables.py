"""Variables of the controller, read and written one by one; writes that matter are read back and compared."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, final

from cellctl.devices import DeviceFault, DeviceRefused, JointReadings
from drivers.kuka_varproxy import literals
from drivers.kuka_varproxy.line import ProxyLine
from drivers.kuka_varproxy.messages import Answer, Kind, text_field

_CURE = "Is the generated program of this cell loaded (cellctl krl), and does its variable belong to this KSS?"

Value = TypeVar("Value")


@final
class Variables:
    """The variables behind a line. A value is text as KRL writes it: `"17"`, `"TRUE"`, `"#EX"`, `"{AXIS: A1 0.0, …}"`.

    Every method raises DeviceRefused (no such variable, or protected), DeviceFault (a value that makes no sense) and
    DeviceLost.
    """

    def __init__(self, device: str, line: ProxyLine) -> None:
        self._device = device
        self._line = line

    async def read(self, name: str) -> str:
        """The value of a variable."""
        answer = await self._line.ask(Kind.READ, self._field(name))
        if not answer.ok:
            raise DeviceRefused(self._device, f"the proxy cannot read {name} (code {answer.code})", _CURE)
        return self._text(name, answer)

    async def write(self, name: str, value: str) -> None:
        """Write a variable. That it was taken is the proxy's word only; see `write_verified`."""
        answer = await self._line.ask(Kind.WRITE, self._field(name) + self._field(value))
        if not answer.ok:
            raise DeviceRefused(self._device, f"the proxy cannot write {name} (code {answer.code})", _CURE)

    async def write_verified(self, name: str, value: str) -> None:
        """Write a variable, read it back and compare. Raises DeviceFault if they differ."""
        await self.write(name, value)
        back = await self.read(name)
        if not self._understood(name, lambda text: literals.same(value, text), back):
            what = f"{name} was written as {value} and read back as {back}"
            raise DeviceFault(self._device, what, "Does another program write to this controller's variables?")

    async def whole(self, name: str) -> int:
        """A variable of type INT."""
        return self._understood(name, literals.whole, await self.read(name))

    async def number(self, name: str) -> float:
        """A variable of type INT or REAL."""
        return self._understood(name, literals.number, await self.read(name))

    async def truth(self, name: str) -> bool:
        """A variable of type BOOL."""
        return self._understood(name, literals.truth, await self.read(name))

    async def text(self, name: str) -> str:
        """A text without quotation marks, or an enumeration: `"#EX"`."""
        return literals.plain_text(await self.read(name))

    async def fields(self, name: str) -> dict[str, str]:
        """The fields of a structure."""
        return self._understood(name, literals.fields, await self.read(name))

    async def joints(self, name: str) -> JointReadings:
        """A1 … A6 of a variable of type E6AXIS, degrees."""
        return self._understood(name, literals.joints, await self.read(name))

    def _field(self, text: str) -> bytes:
        try:
            return text_field(text)
        except ValueError as error:
            raise DeviceRefused(self._device, f"{error}; it was not sent") from None

    def _text(self, name: str, answer: Answer) -> str:
        try:
            return answer.text
        except ValueError as error:
            raise DeviceFault(self._device, f"the answer about {name} makes no sense: {error}") from None

    def _understood(self, name: str, read: Callable[[str], Value], text: str) -> Value:
        try:
            return read(text)
        except ValueError as error:
            raise DeviceFault(self._device, f"the value of {name} makes no sense: {error}") from None
