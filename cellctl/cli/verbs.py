"""`cellctl`: the verbs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any, NamedTuple, final

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command, get_group_from_info
from typer.models import TyperInfo

from cellctl.cli.exit_codes import Interrupted
from cellctl.version import __version__

for _library in ("OPENBLAS", "MKL", "OMP"):  # small matrices: more linear algebra threads only add waiting
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")


@final
class Verb(NamedTuple):
    """A verb: its module in `cellctl.cli`, imported when it runs; its function or group there; its line of help."""

    module: str
    name: str
    help: str


VERBS = {
    "check": Verb("run", "check", "Check a procedure and its cell; nothing moves."),
    "doctor": Verb("cell", "doctor", "Connect to every device of a cell and report its health; nothing moves."),
    "run": Verb("run", "run", "Run a procedure on its cell, after the checks of `check`."),
    "status": Verb("operate", "status", "Show state, step, progress and time left of a run."),
    "pause": Verb("operate", "pause", "Pause a run before its next step."),
    "continue": Verb("operate", "continue_", "Continue a paused run, unless an interlock forbids it."),
    "confirm": Verb("operate", "confirm", "Confirm the step that a run waits at."),
    "acknowledge": Verb("operate", "acknowledge", "Press the reset of a run's simulated cell."),
    "abort": Verb("operate", "abort", "Abort a run: cancel its step, then clean up."),
    "show": Verb("runs", "show", "Show one run: devices, steps, verdict; or compare it with another."),
    "runs": Verb("run_listing", "runs", "List the runs, newest first."),
    "index": Verb("run_listing", "app", "Make the index of the runs again, or compare it with the journals."),
    "fleet": Verb("fleet", "fleet", "Show which robots need a calibration, and why."),
    "report": Verb("runs", "report", "Write the calibration report of a run again, as HTML that prints on A4."),
    "replay": Verb(
        "runs",
        "replay",
        "Compute a run's data set, model and table again from its journal alone; say what differs, and why.",
    ),
    "export": Verb(
        "runs",
        "export",
        "Export a run: its samples as CSV or Parquet, its events as JSON lines or bluesky documents, the pictures of "
        "its report as SVG and PNG, a Digital Calibration Certificate, or all in one zip.",
    ),
    "plan": Verb("plan", "plan", "Choose targets for a calibration with any instrument."),
    "import": Verb(
        "convert",
        "import_data",
        "Make a data set from joint list and measured positions, or targets from a program.",
    ),
    "fit": Verb("fit", "fit", "Identify a robot; compare it with nominal on held-out rows."),
    "prior": Verb("prior", "prior", "Make a prior of a type from the calibrations of its robots."),
    "analyse": Verb("analyse", "analyse", "Analyse the similarity of a robot's errors."),
    "study": Verb("study", "study", "Run many fits or campaigns over factors and seeds; rows as Parquet, and a page."),
    "predict": Verb("fit", "predict", "Predict the TCP at given joints: pose and 1 σ (3-D, mm)."),
    "compensate": Verb(
        "compensate",
        "compensate",
        "Compute compensated joints for targets, as a table, or as CSV for -o FILE.csv.",
    ),
    "table": Verb("table", "app", "Push, show, verify, compare or roll back a compensation table."),
    "convert": Verb("convert", "convert", "Convert a robot file or model to another form."),
    "robots": Verb("robots", "robots", "List the robots that a fit, a plan or a cell may name, or show one."),
    "cell": Verb("cell_file", "cell", "Write a checked cell file for a robot of the library."),
    "krl": Verb("cell", "krl", "Write the files to load on the controller."),
    "firmware": Verb("firmware", "firmware", "Write the contact probe's firmware, to load or to build it."),
    "sim": Verb("cell", "sim", "Run a cell's simulators until Ctrl-C."),
    "new": Verb(
        "new",
        "new",
        "Make a package with a driver, simulator, campaign, effect, row kind or compensation method of your own.",
    ),
    "console": Verb("cell", "console", "Serve the operator's console and its JSON API until Ctrl-C."),
    "users": Verb("users", "app", "Add, remove and change the named users of a console."),
}
"""In the order of work, as the help lists them."""


@final
class _Verbs(TyperGroup):
    """The verbs. Ctrl-C ends them by `Interrupted`; Typer ends a KeyboardInterrupt without a message."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: Any = dict.fromkeys(VERBS)  # names alone: for a mistyped one the nearest is suggested

    def list_commands(self, ctx: Any) -> list[str]:
        return list(VERBS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in VERBS:
            return None
        verb = VERBS[cmd_name]
        found = getattr(import_module(f"cellctl.cli.{verb.module}"), verb.name)
        if isinstance(found, typer.Typer):
            group = TyperInfo(found, name=cmd_name)
            return get_group_from_info(
                group, pretty_exceptions_short=True, suggest_commands=True, rich_markup_mode=None
            )
        single = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
        single.command(cmd_name)(found)
        return get_command(single)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """The verbs with their lines of help, without importing any."""
        room = formatter.width - 6 - max(map(len, VERBS))
        rows = [(name, TyperCommand(name, help=verb.help).get_short_help_str(room)) for name, verb in VERBS.items()]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

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
