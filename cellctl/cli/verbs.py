"""`cellctl`: the verbs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, final

import typer
from typer.core import TyperGroup

from cellctl import __version__
from cellctl.cli.analyse import analyse
from cellctl.cli.cell import console, doctor, krl, sim
from cellctl.cli.compensate import compensate
from cellctl.cli.convert import convert, import_data, robots
from cellctl.cli.ends import Interrupted
from cellctl.cli.fit import fit, predict
from cellctl.cli.plan import plan
from cellctl.cli.run import abort, acknowledge, check, confirm, continue_, pause, run, status
from cellctl.cli.runs import export, replay, report, runs, show
from cellctl.cli.table import app as table

for _library in ("OPENBLAS", "MKL", "OMP"):  # small matrices: more linear algebra threads only add waiting
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")


@final
class _Verbs(TyperGroup):
    """The verbs. Ctrl-C ends them by `Interrupted`; Typer ends a KeyboardInterrupt without a message."""

    def list_commands(self, ctx: Any) -> list[str]:
        names = [name for name in super().list_commands(ctx) if name != "table"]
        names.insert(names.index("compensate") + 1, "table")
        return names

    def make_context(self, *args: Any, **more: Any) -> Any:
        with _interruptible():
            return super().make_context(*args, **more)

    def invoke(self, ctx: Any) -> Any:
        with _interruptible():
            return super().invoke(ctx)


@contextmanager
def _interruptible() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt as interrupt:
        raise Interrupted from interrupt


app = typer.Typer(
    name="cellctl",
    cls=_Verbs,
    help="Robot calibration: measure, identify, compensate, verify.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(value: bool) -> None:
    if value:
        typer.echo(f"cellctl {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    debug: bool = typer.Option(False, "--debug", help="Show tracebacks."),
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Show the version."),
) -> None:
    if debug:
        os.environ["CELLCTL_DEBUG"] = "1"


_VERBS: dict[str, Callable[..., None]] = {
    "check": check,
    "doctor": doctor,
    "run": run,
    "status": status,
    "pause": pause,
    "continue": continue_,
    "confirm": confirm,
    "acknowledge": acknowledge,
    "abort": abort,
    "show": show,
    "runs": runs,
    "report": report,
    "replay": replay,
    "export": export,
    "plan": plan,
    "import": import_data,
    "fit": fit,
    "analyse": analyse,
    "predict": predict,
    "compensate": compensate,
    "convert": convert,
    "robots": robots,
    "krl": krl,
    "sim": sim,
    "console": console,
}
"""In the order of work, as the help lists them; `table` comes after `compensate`."""
for _name, _verb in _VERBS.items():
    app.command(_name)(_verb)
app.add_typer(table, name="table")
