"""`/metrics` as Prometheus' own client reads it: runs, progress, devices, memory; free to read, and no session."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from cellctl.console.server import guarded
from cellctl.console.shared import console
from cellctl.journal import DeviceHealth, DevicesConnected, Journal, RunStarted, SourceFile, StateChanged
from tests.helpers.console import TOKEN, ApiClient, api_client
from tests.helpers.journals import run_in

AWKWARD = 'a "b" \\ c'


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ApiClient]:
    runs = tmp_path_factory.mktemp("runs")
    run_in(runs, "sphere-1", "2026-11-01", "925185")
    run_in(runs, "sphere-2", "2026-11-02", "925185", "worse")
    run_in(runs, "sphere-3", "2026-11-03", "925185", AWKWARD)
    source, ticks = SourceFile("procedures/sphere.yaml", "", ""), count(0, 10**9)
    with Journal.create(runs / "sphere-4", lambda: next(ticks)) as journal:
        journal.append(RunStarted(source, source, {}, 1, "lockstep", "Kim", "2026-11-04T08:00:00Z", "", {}))
        journal.append(DevicesConnected({"robot": {"serial": "925185"}, "probe": {"serial": "1"}}))
        journal.append(DeviceHealth("robot", True, "well", 4.0))
        journal.append(DeviceHealth("probe", False, "no answer"))
        journal.append(StateChanged("connecting", "running"))
        with api_client(runs) as found:
            yield found


@pytest.fixture(scope="module")
def samples(client: ApiClient) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    answer = client.get("/metrics")
    while "cellctl_console_reading 1" in answer.text or 'cellctl_device_ok{run="sphere-4"' not in answer.text:
        answer = client.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    families = list(text_string_to_metric_families(answer.text))
    assert all(family.documentation and family.type == "gauge" for family in families)
    return {(each.name, frozenset(each.labels.items())): each.value for family in families for each in family.samples}


def of(samples: dict[tuple[str, frozenset[tuple[str, str]]], float], name: str, **labels: str) -> list[float]:
    return [value for (found, given), value in samples.items() if found == name and labels.items() <= set(given)]


def test_runs_are_counted_by_procedure_state_and_verdict(samples) -> None:
    assert of(samples, "cellctl_runs", procedure="sphere", state="finished", verdict="better") == [1.0]
    assert of(samples, "cellctl_runs", verdict="worse") == [1.0]
    assert of(samples, "cellctl_runs", verdict=AWKWARD) == [1.0]
    assert of(samples, "cellctl_runs", state="running") == [1.0]
    assert of(samples, "cellctl_console_reading") == [0.0]


def test_a_run_in_progress_has_its_steps_and_devices(samples) -> None:
    assert of(samples, "cellctl_run_steps_done", run="sphere-4", procedure="sphere") == [0.0]
    assert of(samples, "cellctl_run_steps_done", run="sphere-1") == []
    assert of(samples, "cellctl_device_ok", run="sphere-4", device="robot") == [1.0]
    assert of(samples, "cellctl_device_ok", device="probe") == [0.0]
    assert of(samples, "cellctl_device_latency_seconds", device="robot") == [0.004]
    assert of(samples, "cellctl_device_latency_seconds", device="probe") == []


def test_the_consoles_memory_is_stated(samples) -> None:
    assert 1e7 < of(samples, "process_resident_memory_bytes")[0] < 1e11


def test_no_secret_and_no_session(client: ApiClient) -> None:
    async def scraped() -> httpx.Response:
        app = guarded(_empty, console())
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://127.0.0.1:8090") as browser:
            return await browser.get("/metrics")

    assert TOKEN not in client.get("/metrics").text
    assert "set-cookie" not in client.done(scraped()).headers


async def _empty(_scope, _receive, send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b""})
