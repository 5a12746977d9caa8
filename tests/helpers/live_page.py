"""A console with the smallest page that shows a run: `/live-test/RUN`. Arguments: runs folder, port, token."""

from __future__ import annotations

import sys
from pathlib import Path

from nicegui import ui

from cellctl.console import server
from cellctl.console.frame import follow, frame
from cellctl.console.shared import Settings, console


@ui.page("/live-test/{run}")
def live_test(run: str) -> None:
    """The last message of the run; and a button that counts, for the round trip of a page without a run."""
    live = console().live.run(run)
    with frame("Live test", "/run"):
        message = ui.label().props("id=message")
        ui.button("Count", on_click=lambda: count.set_text(str(int(count.text) + 1))).props("id=click")
        count = ui.label("0").props("id=count")

    def show() -> None:
        message.set_text(live.snapshot.status.message)

    follow(show, run)


if __name__ in {"__main__", "__mp_main__"}:
    folder, port, token = sys.argv[1:]
    server.serve(Settings(Path(folder), port=int(port)), lambda _: print("listening", flush=True), token)
