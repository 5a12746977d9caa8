"""Clocks: waiting in the cell's time, and time that waits for the engine."""

from __future__ import annotations

import asyncio
import json
import mmap
import threading
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

import pytest

from cellctl.clock import LockstepClock, WallClock, calendar_time, reader_of

MS = 1_000_000
PATIENCE_S = 60.0


class ScriptedCell:
    """A simulated cell's time file and control port, moved by hand."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "time"
        self.file.write_bytes((5000 * MS).to_bytes(8, "little"))
        with self.file.open("r+b") as stream:
            self._view = mmap.mmap(stream.fileno(), 8)
        self.heard: list[dict] = []
        self.written: dict[str, int] = {}
        self._server: asyncio.Server | None = None
        self._reader: asyncio.StreamReader | None = None
        self._writer: asyncio.StreamWriter | None = None
        self.met = asyncio.Event()

    @property
    def now_ns(self) -> int:
        return int.from_bytes(self._view[:8], "little")

    @now_ns.setter
    def now_ns(self, value: int) -> None:
        self._view[:8] = value.to_bytes(8, "little")

    async def attach(self) -> LockstepClock:
        self._server = await asyncio.start_server(self._meet, "127.0.0.1", 0)
        clock = await LockstepClock.attach(str(self.file), *self._server.sockets[0].getsockname()[:2])
        await self.met.wait()
        return clock

    async def _meet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self.heard.append(json.loads(await reader.readline()))
        self.met.set()

    async def tick(self, ms: float = 20) -> int:
        """Move time on, send the tick, wait for its tock. Returns the cell's time then."""
        self.now_ns += round(ms * MS)
        self.say({"tick": self.now_ns, "wires": self.written})
        answer = {"busy": self.now_ns}
        while answer == {"busy": self.now_ns}:
            answer = json.loads(await self._reader.readline())
        assert answer["tock"] == self.now_ns
        self.heard.append(answer)
        return self.now_ns

    def say(self, message: dict) -> None:
        self.raw(json.dumps(message).encode() + b"\n")

    def raw(self, data: bytes) -> None:
        self._writer.write(data)

    async def die(self) -> None:
        self._writer.close()
        self._server.close()

    async def left(self) -> bytes:
        return await self._reader.read()


@pytest.fixture
def run(tmp_path):
    def run(script: Callable[[ScriptedCell, LockstepClock], Awaitable[None]]) -> None:
        async def whole() -> None:
            async with asyncio.timeout(PATIENCE_S):
                cell = ScriptedCell(tmp_path)
                clock = await cell.attach()
                try:
                    await script(cell, clock)
                finally:
                    await clock.aclose()
                    await cell.die()

        asyncio.run(whole())

    return run


def test_attaching_says_so_and_time_is_the_cells(run):
    async def script(cell, clock):
        assert cell.heard == [{"op": "attach", "name": "engine"}]
        assert clock.now_ns() == 5000 * MS
        cell.now_ns = 6000 * MS
        assert clock.now() == pytest.approx(6.0)
        assert reader_of(clock.source)() == 6000 * MS

    run(script)


def test_due_timers_have_fired_before_the_tick_is_answered(run):
    async def script(cell, clock):
        fired = []
        for ms in (35, 10, 20, 60):
            clock.call_later(ms / 1000, lambda ms=ms: fired.append(ms))
        await cell.tick()
        assert fired == [10, 20]
        await cell.tick()
        assert fired == [10, 20, 35]
        await cell.tick()
        assert fired == [10, 20, 35, 60]

    run(script)


def test_what_a_sleeper_does_next_is_done_before_time_goes_on(run):
    async def script(cell, clock):
        woke = []

        async def sleeper():
            await clock.sleep(0.015)
            woke.append(cell.now_ns)

        task = asyncio.create_task(sleeper())
        await asyncio.sleep(0)
        assert await cell.tick() == woke[0]
        await task

    run(script)


def test_time_stands_still_for_a_sleeper_until_the_cell_moves(run):
    async def script(cell, clock):
        task = asyncio.create_task(clock.sleep(0.001))
        for _ in range(50):
            await asyncio.sleep(0)
        assert not task.done()
        await cell.tick()
        await task

    run(script)


def test_a_timer_taken_back_does_not_fire(run):
    async def script(cell, clock):
        fired = []
        clock.call_later(0.01, lambda: fired.append(1)).cancel()
        await cell.tick()
        assert fired == []

    run(script)


def test_a_timeout_in_cell_time_raises_timeout_error_and_cancels_the_body(run):
    async def script(cell, clock):
        ends = []

        async def body():
            try:
                async with clock.timeout(0.03):
                    try:
                        await asyncio.Event().wait()
                    except asyncio.CancelledError:
                        ends.append(clock.now_ns())
                        raise
            except TimeoutError:
                ends.append("timeout")

        task = asyncio.create_task(body())
        await asyncio.sleep(0)
        await cell.tick()
        assert not task.done()
        await cell.tick()
        await task
        assert ends == [5040 * MS, "timeout"]

    run(script)


def test_a_body_that_is_done_in_time_is_left_alone_and_its_timer_is_gone(run):
    async def script(cell, clock):
        async with clock.timeout(0.01):
            pass
        async with clock.timeout(None):
            await cell.tick(50)
        await cell.tick(50)

    run(script)


def test_cancelling_a_body_under_a_timeout_is_a_cancellation_not_a_timeout(run):
    async def script(cell, clock):
        async def body():
            async with clock.timeout(10):
                await asyncio.Event().wait()

        task = asyncio.create_task(body())
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    run(script)


def test_a_timer_that_raises_does_not_stop_the_cells_time(run):
    async def script(cell, clock):
        told = []
        asyncio.get_running_loop().set_exception_handler(lambda _loop, context: told.append(context["exception"]))
        clock.call_later(0.01, lambda: 1 / 0)
        after = asyncio.Event()
        clock.call_later(0.015, after.set)
        await cell.tick()
        assert after.is_set()
        assert isinstance(told[0], ZeroDivisionError)

    run(script)


def test_other_answers_on_the_control_port_are_not_ticks(run):
    async def script(cell, clock):
        cell.say({"ok": True})
        await cell.tick()

    run(script)


@pytest.mark.parametrize("last_words", [b"", b'{"tick": 50', b"what?\n", b"[]\n", b"x" * 100_000])
def test_when_the_simulator_dies_time_runs_on_with_the_wall_and_timeouts_end(run, last_words):
    async def script(cell, clock):
        cell.raw(last_words)
        before = clock.now_ns()
        await cell.die()
        with pytest.raises(TimeoutError):
            async with clock.timeout(0.05):
                await asyncio.Event().wait()
        assert clock.now_ns() > before
        later = clock.now_ns()
        assert later <= clock.now_ns()

    run(script)


async def _stays_open(task: asyncio.Task) -> bool:
    """Whether `task` is still at work after many turns of the loop."""
    for _ in range(200):
        await asyncio.sleep(0)
    return not task.done()


def test_a_tick_is_answered_when_nothing_more_is_to_be_done_however_many_turns_of_the_loop_that_takes(run):
    async def script(cell, clock):
        done = []

        async def long_chain():
            await clock.sleep(0.01)
            for _ in range(100):
                await asyncio.sleep(0)
            done.append(cell.now_ns)

        chain = asyncio.create_task(long_chain())
        await asyncio.sleep(0)
        assert await cell.tick() == done[0]
        await chain

    run(script)


def test_while_the_engine_computes_the_cells_time_stands_still(run):
    async def script(cell, clock):
        may_end = threading.Event()
        fit = asyncio.create_task(clock.compute(may_end.wait, PATIENCE_S))
        await asyncio.sleep(0)
        tick = asyncio.create_task(cell.tick(20))
        assert await _stays_open(tick)
        may_end.set()
        assert await fit
        await tick

    run(script)


def test_a_long_computation_tells_the_simulator_that_the_engine_is_at_work(run, monkeypatch):
    monkeypatch.setattr("cellctl.clock.clocks._BUSY_EVERY_S", 0.001)

    async def script(cell, clock):
        with clock.standing():
            cell.say({"tick": cell.now_ns, "wires": {}})
            assert json.loads(await cell._reader.readline()) == {"busy": cell.now_ns}
        while "tock" not in json.loads(await cell._reader.readline()):
            pass

    run(script)


def test_what_the_cell_wrote_is_read_before_its_tick_is_answered_and_before_timers_run(run):
    async def script(cell, clock):
        order = []
        probe = clock.wire("probe")
        clock.call_later(0.01, lambda: order.append("timer"))
        cell.written = {"probe": 30, "not opened by the engine": 7}
        tick = asyncio.create_task(cell.tick(20))
        assert await _stays_open(tick)
        probe.read(10)
        assert await _stays_open(tick)
        order.append("read")
        probe.read(20)
        await tick
        assert order == ["read", "timer"]

    run(script)


def test_a_thread_that_reads_lets_the_tick_be_answered(run):
    async def script(cell, clock):
        probe = clock.wire("probe")
        cell.written = {"probe": 5}
        threading.Timer(0.02, lambda: probe.read(5)).start()
        await cell.tick(20)

    run(script)


def test_bytes_of_the_cell_that_never_arrive_are_lost_after_a_time_and_the_cells_time_goes_on(run, monkeypatch):
    monkeypatch.setattr("cellctl.clock.clocks._BUSY_EVERY_S", 0.02)

    async def script(cell, clock):
        probe = clock.wire("probe")
        probe.read(37)
        cell.written = {"probe": 68}  # the first line was discarded when the port was opened
        await cell.tick(20)
        cell.written = {"probe": 105}
        tick = asyncio.create_task(cell.tick(20))
        await asyncio.sleep(0)
        probe.read(37)
        await tick
        assert not clock._standing

    run(script)


def test_work_of_this_computer_may_take_longer_than_bytes_that_are_lost(run, monkeypatch):
    monkeypatch.setattr("cellctl.clock.clocks._BUSY_EVERY_S", 0.01)

    async def script(cell, clock):
        probe = clock.wire("probe")
        cell.written = {"probe": 5}
        with clock.standing():
            tick = asyncio.create_task(cell.tick(20))
            await asyncio.sleep(0.3)
            assert not probe.has_read(5)
            probe.read(5)
        await tick

    run(script)


def test_a_tock_says_what_the_engine_has_written(run):
    async def script(cell, clock):
        probe = clock.wire("probe")
        probe.wrote(7)
        await cell.tick(20)
        probe.wrote(5)
        await cell.tick(20)
        assert [tock["wires"] for tock in cell.heard[1:]] == [{"probe": 7}, {"probe": 12}]

    run(script)


def test_a_wire_counts_from_when_it_was_opened_and_nobody_waits_for_one_that_is_closed(run):
    async def script(cell, clock):
        cell.written = {"robot": 1000}
        await cell.tick(20)
        first = clock.wire("robot")
        await cell.tick(20)
        cell.written = {"robot": 1500}
        tick = asyncio.create_task(cell.tick(20))
        assert await _stays_open(tick)
        first.close()
        await tick
        second = clock.wire("robot")
        second.wrote(3)
        await cell.tick(20)
        assert cell.heard[-1]["wires"] == {"robot": 3}

    run(script)


def test_a_computation_beyond_its_timeout_ends_by_timeout_in_lockstep_too(run):
    async def script(cell, clock):
        may_end = threading.Event()

        async def fit():
            async with clock.timeout(0.03):
                await clock.compute(may_end.wait, PATIENCE_S)

        task = asyncio.create_task(fit())
        await asyncio.sleep(0)
        with pytest.raises(TimeoutError):
            await task
        may_end.set()
        await cell.tick(3_600_000)

    run(script)


def test_closing_detaches(run):
    async def script(cell, clock):
        await clock.aclose()
        assert await cell.left() == b""

    run(script)


def test_wall_time_counts_from_its_epoch_and_another_process_reads_the_same():
    clock = WallClock(epoch_ns=time.monotonic_ns())
    read = reader_of(clock.source)
    first, second, third = clock.now_ns(), read(), clock.now_ns()
    assert 0 <= first <= second <= third


def test_wall_sleep_and_timeout_follow_the_wall():
    async def script():
        clock = WallClock()
        begun = clock.now_ns()
        await clock.sleep(0.01)
        assert clock.now_ns() - begun >= 9 * MS
        with pytest.raises(TimeoutError):
            async with clock.timeout(0.01):
                await asyncio.Event().wait()
        async with clock.timeout(5):
            await clock.sleep(0)

    asyncio.run(asyncio.wait_for(script(), PATIENCE_S))


def test_a_sleep_that_is_cancelled_leaves_no_timer_behind():
    async def script():
        clock = WallClock()
        task = asyncio.create_task(clock.sleep(60))
        await asyncio.sleep(0)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        assert not [h for h in asyncio.get_running_loop()._scheduled if not h.cancelled()]

    asyncio.run(script())


@pytest.mark.parametrize("source", ["sundial:", "wall:", "wall:noon", ""])
def test_a_source_that_is_none_is_a_value_error(source):
    with pytest.raises(ValueError):
        reader_of(source)


def test_a_time_file_that_is_missing_or_too_short_is_an_os_error(tmp_path):
    (tmp_path / "short").write_bytes(b"1234")
    (tmp_path / "empty").write_bytes(b"")
    for name in ("short", "empty", "missing"):
        with pytest.raises(OSError, match=name):
            reader_of(f"file:{tmp_path / name}")


def test_the_calendar_is_utc_to_the_second():
    assert len(calendar_time()) == 20
    assert time.strptime(calendar_time(), "%Y-%m-%dT%H:%M:%SZ")


def test_a_wire_opened_again_counts_what_the_one_before_has_read_though_no_tick_told_of_it(tmp_path):
    time_file = tmp_path / "time"
    time_file.write_bytes(bytes(8))

    async def reopened():
        clock = LockstepClock(str(time_file))
        before = clock.wire("plc")
        before.read(49)
        before.close()
        again = clock.wire("plc")
        return again.has_read(49), again.has_read(50)

    assert asyncio.run(reopened()) == (True, False)


def test_a_timeout_elsewhere_counts_the_cells_time_while_another_task_stops_it(run):
    async def script(cell, clock):
        async def waits_for_its_device():
            async with clock.timeout(0.01):
                await answered.wait()
            return "answered"

        answered = asyncio.Event()
        waiting = asyncio.create_task(waits_for_its_device())
        await asyncio.sleep(0)
        with clock.standing():
            await asyncio.sleep(0.05)  # five times as long
        answered.set()
        assert await waiting == "answered"

    run(script)


def test_a_timeout_around_or_inside_work_of_this_computer_counts_wall_time(run):
    async def script(cell, clock):
        async def around():
            async with clock.timeout(0.01):
                with clock.standing():
                    await asyncio.sleep(PATIENCE_S)

        async def inside():
            with clock.standing():
                async with clock.timeout(0.01):
                    await asyncio.sleep(PATIENCE_S)

        for work in (around, inside):
            with pytest.raises(TimeoutError):
                await work()

    run(script)


def test_a_task_that_outlives_the_timeout_it_was_started_in_may_stop_the_cells_time(run):
    async def script(cell, clock):
        async def works():
            await begin.wait()
            with clock.standing():
                await asyncio.sleep(0)
            return "done"

        begin = asyncio.Event()
        async with clock.timeout(0.01):
            task = asyncio.create_task(works())
        begin.set()
        assert await task == "done"

    run(script)
