"""Executes a URScript program: its threads, cycle by cycle of the controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from inspect import signature
from typing import final

from sims.ur._script_expressions import Frame, Halt, Running, ScriptError, Thread, Value
from sims.ur._script_parser import Script
from sims.ur._script_statements import Function, called, execute

SHARE = 5_000
"""Loops and calls that a thread may do in a cycle; then it goes on in the next one."""

Builtin = Callable[..., Value]


@final
class Machine:
    """One program. `builtins`: the controller's functions by their names."""

    def __init__(self, script: Script, builtins: Mapping[str, Builtin]) -> None:
        self.name = script.name
        self.functions: Mapping[str, Function] = script.functions
        self.current: Thread | None = None
        self._builtins = builtins
        self._threads: dict[int, Thread] = {}
        self._numbers = 0
        main = self._thread()
        self.globals = Frame(self, main, None)
        main.running = self._main(script, self.globals)

    @property
    def ended(self) -> bool:
        """Whether the program is over: its threads end with it."""
        return not self._threads

    @property
    def line(self) -> int:
        """Where the program is, from 1; 0 when it is over."""
        return next(iter(self._threads.values())).line if self._threads else 0

    def cycle(self) -> None:
        """Each thread goes on until it has used its time of this cycle. Raises ScriptError, which ends the program."""
        critical = next((thread for thread in self._threads.values() if thread.critical), None)
        for thread in [critical] if critical else list(self._threads.values()):
            if thread.number not in self._threads or thread.running is None:
                continue
            self.current, thread.spent = thread, 0
            try:
                next(thread.running)
            except StopIteration:
                self._threads.pop(thread.number, None)
            except ScriptError as error:
                error.line = error.line or thread.line
                self.stop()
                raise
            except Halt:
                self.stop()
                return
            except RecursionError:
                self.stop()
                raise ScriptError("Stack overflow", thread.line) from None
            finally:
                self.current = None
            if thread.number == 1 and 1 not in self._threads:
                self.stop()
                return
            if thread.critical and thread.number in self._threads:
                return  # it entered its critical section in this cycle

    def stop(self) -> None:
        """End every thread."""
        for number in list(self._threads):
            self.kill(number)

    def spend(self, thread: Thread) -> Running:
        """A loop or a call: a thread that computes without end goes on in the next cycle."""
        thread.spent += 1
        if thread.spent > SHARE:
            yield

    def start_thread(self, name: str, program: Frame, line: int) -> int:
        """Its number; it begins in the next cycle. Raises ScriptError."""
        function = self.functions.get(name)
        if function is None or not function.thread:
            raise ScriptError(f"{name} is no thread", line)
        thread = self._thread()
        thread.running = self._body(function, program, thread, line)
        return thread.number

    def kill(self, number: Value) -> None:
        """End a thread; nothing happens where it has ended."""
        thread = self._threads.pop(number, None) if isinstance(number, int) else None
        if thread and thread.running and thread is not self.current:
            thread.running.close()

    def alive(self, number: Value) -> bool:
        """Whether a thread is still there."""
        return number in self._threads

    def builtin(self, name: str, values: Sequence[Value], named: Mapping[str, Value], line: int) -> Value:
        """Call a function of the controller. Raises ScriptError."""
        function = self._builtins[name]
        try:
            return function(*values, **named)
        except (TypeError, ValueError, IndexError, OverflowError) as error:
            raise ScriptError(f"Type error: {name}: {_misfit(function, values, named) or error}", line) from None
        except ScriptError as error:
            error.line = error.line or line
            raise

    def _thread(self) -> Thread:
        self._numbers += 1
        thread = Thread(self._numbers)
        self._threads[thread.number] = thread
        return thread

    def _main(self, script: Script, frame: Frame) -> Running:
        yield from execute(script.body, frame)

    def _body(self, function: Function, program: Frame, thread: Thread, line: int) -> Running:
        frame = Frame(self, thread, program)
        yield from called(function, (), {}, frame, line)


def run_at_once(script: Script, builtins: Mapping[str, Builtin]) -> None:
    """A secondary program, which takes no time of the robot. Raises ScriptError."""
    machine = Machine(script, builtins)
    machine.cycle()
    if not machine.ended:
        line = machine.line
        machine.stop()
        raise ScriptError("SECONDARY_PROGRAM_EXCEPTION_XXX a secondary program takes no time of the robot", line)


def _misfit(function: Builtin, values: Sequence[Value], named: Mapping[str, Value]) -> str:
    """Why a function does not take these arguments; empty if it does."""
    try:
        signature(function).bind(*values, **named)
    except TypeError as error:
        return str(error)
    return ""


def is_blocking(function: Builtin) -> bool:
    """Whether a function of the controller takes time: it is written as a generator."""
    return bool(getattr(function, "__code__", None) and function.__code__.co_flags & 0x20)
