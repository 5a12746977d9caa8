"""In the head of every page: what waits for a person, in the tab's title too, a sound, the number of alarms."""

from __future__ import annotations

from typing import final

from nicegui import ui

from cellctl.console.shared import console

SCRIPT = """
window.attention = (() => {
  const root = document.documentElement, wanted = () => localStorage.getItem("cellctl sound") === "on";
  let audio = null;
  const show = () => {
    root.dataset.sound = !wanted() ? "off" : audio && audio.state === "running" ? "on" : "blocked";
  };
  const open = async () => {
    if (!wanted()) return show();
    audio = audio || new AudioContext();
    audio.onstatechange = show;
    if (audio.state !== "running") audio.resume();
    show();
  };
  const call = () => {
    if (!wanted() || !audio || audio.state !== "running") return;
    for (const [after, pitch] of [[0, 880], [0.25, 660], [0.5, 880]]) {
      const tone = audio.createOscillator(), volume = audio.createGain(), at = audio.currentTime + after;
      tone.frequency.value = pitch;
      volume.gain.setValueAtTime(0.2, at);
      volume.gain.exponentialRampToValueAtTime(0.001, at + 0.2);
      tone.connect(volume).connect(audio.destination);
      tone.start(at);
      tone.stop(at + 0.2);
    }
    root.dataset.called = Number(root.dataset.called || 0) + 1;
  };
  addEventListener("click", event => {
    if (event.target.closest && event.target.closest(".sound")) {
      localStorage.setItem("cellctl sound", wanted() && root.dataset.sound === "on" ? "off" : "on");
      open().then(() => setTimeout(call, 50));
    }
  }, true);
  for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, () => open(), true);
  open();
  return { call };
})();
"""
"""A browser lets a page sound only after a click or a key on it, and forgets that with some changes of the page."""


@final
class Attention:
    """The line below the navigation; it is there only while something waits."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._seen: tuple[str, ...] | None = None
        with ui.element("div").classes("attention").props("role=status") as self._line:
            ui.icon("notifications_active").props("aria-hidden=true")
            self._link = ui.link("", "/").classes("attention-link")
        self._line.set_visibility(False)

    def show(self) -> None:
        """Show what waits; call if that is more than before."""
        waiting = console().watch.waiting
        now = tuple(each.what for each in waiting)
        if now == self._seen:
            return
        new, self._seen = set() if self._seen is None else set(now) - set(self._seen), now
        self._line.set_visibility(bool(now))
        more = f" (and {len(now) - 1} more)" if len(now) > 1 else ""
        if waiting:
            self._link.set_text(f"Waits for you: {now[0]}{more}")
            self._link.props["href"] = waiting[0].address
            self._link.update()
        ui.page_title(f"({len(now)}) Waits for you · {self._title}" if now else self._title)
        if new:
            ui.run_javascript("attention.call()")


def sound_switch() -> None:
    """The button that lets this browser sound when something waits. Its words are chosen by the style sheet."""
    with ui.element("button").classes("command sound").props("type=button"):
        for name, text in (("off", "Sound off"), ("on", "Sound on"), ("blocked", "Sound: click here")):
            with ui.element("span").classes(f"when-{name}"):
                ui.label(text)


@final
class AlarmCount:
    """The number of alarms that nobody has acknowledged, behind the name of their page."""

    def __init__(self, link: ui.link) -> None:
        self._link, self._name = link, link.text

    def show(self) -> None:
        """Show the number."""
        number = len(console().watch.alarms.unseen)
        text = f"{self._name} ({number})" if number else self._name
        if self._link.text != text:
            self._link.set_text(text)
            self._link.classes(add="alarmed" if number else "", remove="" if number else "alarmed")
