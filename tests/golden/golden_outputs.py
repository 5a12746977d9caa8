"""What the command line and a seeded run give, in a form that can be compared: exit codes, JSON, models, journals.

`python tests/golden/golden_outputs.py` writes `expected/` anew: only where a figure is meant to change; the commit says
so. Texts for people are not part of it; figures, verdicts, exit codes and the rows of the journal are.
"""

from __future__ import annotations

import contextlib
import gzip
import json
import sqlite3
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cellctl.cli.exit_codes import exit_code_of
from cellctl.cli.verbs import app
from cellctl.operations.replay._run import close

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
INPUTS, EXPECTED = HERE / "inputs", HERE / "expected"

WORDS = {
    "sentence", "verdict_reason", "sigma_reason", "reason", "text", "unobservable", "seconds", "wall_s", "created",
    "run", "versions", "ended", "cell_sha256", "cure", "story", "warnings", "error", "message", "words", "title",
    "calendar",
}  # fmt: skip
"""Keys whose values are texts for people, or tell of this computer and this hour."""

HASHES = {"prior_sha256", "model_sha256", "id"}
"""Keys of the SHA-256 of a model or table: it has the last digits of numbers that are compared by themselves."""

NEW_ROWS = ("artefact", "residuals", "identification")
"""Kinds of rows that came after the freeze."""

FITS: dict[str, tuple[str, ...]] = {
    "positions": ("fit", "robot.yaml", "positions.csv", "--seed", "3"),
    "positions_folds": ("fit", "robot.yaml", "positions.csv", "--model", "geometry", "--folds", "4"),
    "touches": ("fit", "robot.yaml", "touches.csv", "--artefact", "artefact.yaml", "--model", "geometry"),
    "poses": ("fit", "six.yaml", "poses.csv", "--model", "geometry+compliance"),
    "harmonics": ("fit", "six.yaml", "poses.csv", "--model", "geometry+compliance+harmonics"),
    "partial": ("fit", "robot.yaml", "positions.csv", "--prior", "positions.model.json", "--free", "zeros"),
}  # fmt: skip
REFUSALS: dict[str, tuple[str, ...]] = {
    "no such file": ("fit", "robot.yaml", "absent.csv"),
    "no such option": ("fit", "robot.yaml", "positions.csv", "--measure", "nothing"),
    "unknown effect": ("fit", "robot.yaml", "positions.csv", "--model", "geometry+magic"),
    "joints of another robot": ("fit", "six.yaml", "positions.csv"),
    "touches without spheres": ("fit", "robot.yaml", "touches.csv"),
    "targets without places": ("compensate", "poses.model.json", "joints.csv"),
    "no procedure": ("check", "absent.yaml"),
    "no run": ("show", "absent"),
}


def cellctl(folder: Path, *words: str) -> int:
    """Run the command line in `folder`, in this process; its exit code."""
    with contextlib.chdir(folder):
        return exit_code_of(lambda: app([*words], standalone_mode=False))


def fit_output(folder: Path, name: str) -> dict[str, Any]:
    """Exit code, JSON and model of a fit in `folder`, which holds the inputs."""
    words = FITS[name]
    code = cellctl(folder, *words, "--json", f"{name}.json", "--out", f"{name}.model.json")
    model = folder / f"{name}.model.json"
    return {
        "exit": code,
        "json": _read(folder / f"{name}.json"),
        "model": _read(model) if model.exists() else None,
    }


def predicted(folder: Path) -> dict[str, Any]:
    """`predict` with the model of poses, and `compensate` for the poses predicted."""
    codes = [
        cellctl(folder, "predict", "poses.model.json", "joints.csv", "-o", "predicted.csv"),
        cellctl(folder, "compensate", "poses.model.json", "predicted.csv", "--serial", "K1", "-o", "compensated.json"),
    ]
    table = folder / "compensated.json"
    return {
        "exit": codes,
        "predicted": (folder / "predicted.csv").read_text().splitlines(),
        "table": _read(table) if table.exists() else None,
    }


def run_output(folder: Path) -> dict[str, Any]:
    """Exit code, result, model and journal of a short seeded campaign on the simulated cell."""
    procedure = ROOT / "procedures" / "sphere_single.yaml"
    settings = ("--set", "touches_fit=14", "--set", "touches_test=6", "--set", "reference_every=8", "--seed", "5")
    code = cellctl(folder, "run", str(procedure), *settings, "--runs", "runs", "--json", "run.json")
    run = next((folder / "runs").glob("*/journal.sqlite")).parent
    return {
        "exit": code,
        "json": _read(folder / "run.json"),
        "model": _read(run / "model.json"),
        "dataset": (run / "dataset.csv").read_text().splitlines(),
        "journal": journal_of(run),
    }


def journal_of(run: Path) -> list[dict[str, Any]]:
    """The rows of the campaign and the ends of its steps, as SQLite holds them; of the kinds there were when frozen."""
    connection = sqlite3.connect(f"file:{run / 'journal.sqlite'}?mode=ro", uri=True)
    columns = "SELECT kind, step, attempt, data FROM events ORDER BY seq"
    rows = [(kind, step, attempt, json.loads(data)) for kind, step, attempt, data in connection.execute(columns)]
    connection.close()
    kept = {"recorded", "step_started", "step_ended", "run_ended", "state_changed"}
    return [
        {"kind": kind, "step": step, "attempt": attempt, "data": without_words(data)}
        for kind, step, attempt, data in rows
        if kind in kept and data.get("row_kind") not in NEW_ROWS
    ]


def without_words(value: Any) -> Any:
    """The same JSON without what is text for people, or of this computer and hour."""
    if isinstance(value, dict):
        return {key: _kept(key, item) for key, item in value.items() if key not in WORDS}
    return [without_words(item) for item in value] if isinstance(value, list) else value


def _kept(key: str, value: Any) -> Any:
    """Of a covariance its diagonal alone: the whole is megabytes."""
    if key == "covariance" and isinstance(value, list):
        return [row[place] for place, row in enumerate(value)]
    return without_words(value)


def differences(old: Any, new: Any, place: str = "$") -> list[str]:
    """Where `new` differs from `old` by more than the tolerance of a replay; keys that `old` lacks are allowed."""
    if isinstance(old, dict) and isinstance(new, dict):
        missing = [f"{place}.{key} is missing" for key in old.keys() - new.keys()]
        both = [key for key in old.keys() & new.keys() if not (key in HASHES and len(str(old[key])) == _SHA256)]
        return missing + [d for key in both for d in differences(old[key], new[key], f"{place}.{key}")]
    if isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            return [f"{place} has {len(new)} entries, not {len(old)}"]
        return [d for i, pair in enumerate(zip(old, new, strict=True)) for d in differences(*pair, f"{place}[{i}]")]
    if isinstance(old, (int, float)) and isinstance(new, (int, float)) and not isinstance(old, bool):
        return [] if close(old, new) else [f"{place} is {new!r}, not {old!r}"]
    if isinstance(old, str) and isinstance(new, str) and "," in old:
        return _csv_differences(old, new, place)
    return [] if old == new else [f"{place} is {new!r}, not {old!r}"]


_SHA256 = 64
"""Its length, in hexadecimal digits."""


def _csv_differences(old: str, new: str, place: str) -> list[str]:
    def cells(line: str) -> list[Any]:
        return [_number(cell) for cell in line.split(",")]

    return [] if old == new else differences(cells(old), cells(new), place) or []


def _number(cell: str) -> Any:
    try:
        return float(cell)
    except ValueError:
        return cell


def _read(path: Path) -> Any:
    return without_words(json.loads(path.read_text()))


def read_expected(name: str) -> Any:
    """The frozen output `name`."""
    return json.loads(gzip.decompress((EXPECTED / f"{name}.json.gz").read_bytes()))


def freeze(folder: Path, to: Path) -> None:
    """Write every output, made in `folder`, which holds the inputs."""
    to.mkdir(exist_ok=True)
    outputs: dict[str, Callable[[], Any]] = {
        **{name: (lambda name=name: fit_output(folder, name)) for name in FITS},
        "predicted": lambda: predicted(folder),
        "refusals": lambda: {name: cellctl(folder, *words) for name, words in REFUSALS.items()},
        "run": lambda: run_output(folder),
    }
    for name, output in outputs.items():
        text = json.dumps(output(), sort_keys=True, ensure_ascii=False)
        (to / f"{name}.json.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
        print(name, len(text), file=sys.stderr)


if __name__ == "__main__":
    import shutil
    import tempfile

    with tempfile.TemporaryDirectory() as scratch:
        inputs = Path(shutil.copytree(INPUTS, Path(scratch) / "golden"))
        freeze(inputs, Path(sys.argv[1]) if len(sys.argv) > 1 else EXPECTED)
