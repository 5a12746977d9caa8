"""`cellctl.fit`: the fit of the command line, for Python."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cellctl.calibration.identification.progress import Progress
from cellctl.facade._inputs import Robot, read, robot
from cellctl.facade._models import Model, load
from cellctl.formats import RobotFile, load_artefact
from cellctl.installed import shipped_file
from cellctl.operations.fit_options import Asked, Judging
from cellctl.operations.fitting import FitInput, fit_rows

_DEFAULT_PRIOR = Path("prior")


def fit(
    robot: str | Path | RobotFile | Robot,
    data: Any,
    *,
    measure: str | None = None,
    model: str = "auto",
    artefact: str | Path | None = None,
    distances: bool = True,
    spacing: str | Sequence[str] = (),
    own: str | Sequence[str] = "base",
    prior: str | Path | Model | None = None,
    free: str | Sequence[str] | None = None,
    check: bool = True,
    holdout: float | None = None,
    folds: int | None = None,
    column: str | None = None,
    by: str | None = None,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Model:
    """Identify a robot, and judge it on held-out rows, as `cellctl fit` does (docs/reference/fit.md).

    - robot: as `cellctl.robot` takes it. data: as `cellctl.read` takes it.
    - measure: use rows of one kind (position, pose, sphere, plane, socket, distance).
    - model: `auto`, `registration`, `geometry` or `zeros`, and effects (`geometry+compliance`).
    - artefact: file with spheres, sockets and certified distances; distances: use these.
    - spacing: known distances, `"A,B=50±0.01"`, mm and 1 σ.
    - own: what each session has for itself (`base`, `tool`, both, `none`).
    - prior: model to be updated; free: groups that may change.
    - check: look for set-up errors first.
    - holdout (share of the rows), folds (number), column (`set`), by (a column, such as `session`): how rows are held
      out; by default the column `set`, else five folds. seed: of the random hold-out.
    - progress: is called with the activity and the share (0 … 1) of its work.

    Raises InputError with all errors of the call, of the files, or of the set-up. Messages name options as on the
    command line. The same seed gives the same model.
    """
    asked = Asked(
        measure,
        model,
        Path(artefact) if artefact is not None else None,
        distances,
        (spacing,) if isinstance(spacing, str) else tuple(spacing),
        _joined(own),
        _name_of(prior),
        _joined(free) if free is not None else None,
    )
    judging = Judging(holdout, folds, column, by, seed)
    asked.refuse(judging)

    given = _given(robot, data, asked, prior)
    shown = None if progress is None else _told(progress)
    return Model.fitted(fit_rows(given, asked, judging, shown, check=check))


def _given(
    source: str | Path | RobotFile | Robot, data: Any, asked: Asked, prior: str | Path | Model | None
) -> FitInput:
    """The input, read; two paths are read as by the command line, which recognises swapped files."""
    if isinstance(source, str | Path) and isinstance(data, str | Path) and not isinstance(prior, Model):
        return FitInput.load(shipped_file("robot", Path(source)), Path(data), asked)

    def given_robot() -> tuple[Any, RobotFile]:
        found = robot(source)
        return found.document, found.file

    return FitInput.read(
        given_robot,
        lambda: read(data).rows,
        lambda: load_artefact(asked.artefact) if asked.artefact else None,
        lambda: None if prior is None else prior.file if isinstance(prior, Model) else load(prior).file,
    )


def _joined(names: str | Sequence[str]) -> str:
    return names if isinstance(names, str) else ",".join(names)


def _name_of(prior: str | Path | Model | None) -> Path | None:
    if isinstance(prior, Model):
        return prior.path or _DEFAULT_PRIOR
    return Path(prior) if prior is not None else None


def _told(progress: Progress) -> Callable[[str], Any]:
    """Reports of the check and of the fit, each from 0 to 1, to `progress`."""

    @contextmanager
    def shown(name: str) -> Iterator[Progress]:
        yield lambda doing, share: progress(": ".join(word for word in (name, doing) if word), share)

    return shown
