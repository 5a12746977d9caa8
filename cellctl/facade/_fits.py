"""`cellctl.fit` and `cellctl.compare`: the fits of the command line, for Python."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from cellctl.calibration.identification.progress import Progress
from cellctl.calibration.verdict.comparison import ComparedFits
from cellctl.facade._inputs import Robot, read, robot
from cellctl.facade._models import Model, load
from cellctl.files import write_atomically
from cellctl.formats import RobotFile, load_artefact
from cellctl.installed import shipped_file
from cellctl.operations.fit_options import Asked, Judging
from cellctl.operations.fitting import FitInput, compare_fits, fit_rows
from cellctl.report.compared_fits import compared_page

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
    prior_of_type: str | Path | None = None,
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
    - prior_of_type: what other robots of this type were like, a file of `cellctl prior`.
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
        _path(artefact),
        distances,
        _listed(spacing),
        _joined(own),
        _name_of(prior),
        _joined(free) if free is not None else None,
        _path(prior_of_type),
    )
    judging = Judging(holdout, None if folds is None else int(folds), column, by, int(seed))
    asked.refuse(judging)

    given = _given(robot, data, asked, prior)
    return Model.fitted(fit_rows(given, asked, judging, _shown(progress), check=check))


@final
@dataclass(frozen=True, eq=False)
class Comparison:
    """Models on the same held-out rows. sentence: which leaves the least; models: a mapping of figures (mm) for each,
    the first is `auto`; report: what `cellctl fit --compare --json` writes.
    """

    _found: ComparedFits
    _given: FitInput

    @property
    def sentence(self) -> str:
        """Which model leaves the least, and whether surely less than the first."""
        return self._found.sentence

    @property
    def models(self) -> list[dict[str, Any]]:
        """The figures of each model, for `pandas.DataFrame`."""
        return list(self.report["models"])

    @property
    def report(self) -> dict[str, Any]:
        """The comparison as JSON."""
        return self._found.report()

    def page(self, path: str | Path | None = None) -> str:
        """The comparison as an HTML page, written to `path` if given. Raises OSError."""
        text = compared_page(self._found, self._given.robot.name, self._given.sources)
        if path is not None:
            write_atomically(Path(path), text)
        return text

    def __repr__(self) -> str:
        return f"<cellctl comparison of {len(self._found.models)} models: {self.sentence}>"


def compare(
    robot: str | Path | RobotFile | Robot,
    data: Any,
    models: str | Sequence[str] = "usual",
    *,
    measure: str | None = None,
    artefact: str | Path | None = None,
    distances: bool = True,
    spacing: str | Sequence[str] = (),
    own: str | Sequence[str] = "base",
    check: bool = True,
    holdout: float | None = None,
    folds: int | None = None,
    column: str | None = None,
    by: str | None = None,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Comparison:
    """Fit `auto` and other models to the same rows and judge them on the same held-out ones, as `cellctl fit --compare`
    does (docs/reference/error-maps.md).

    - models: a name, or several, as for `fit`; `usual` stands for some that need nothing more.
    - All others as for `fit`.

    Raises InputError as `fit` does, where no row is held out, and where a model cannot be fitted to these rows.
    """
    asked = Asked(measure, "auto", _path(artefact), distances, _listed(spacing), _joined(own), None, None)
    judging = Judging(holdout, None if folds is None else int(folds), column, by, int(seed))
    asked.refuse(judging)
    given = _given(robot, data, asked, None)
    return Comparison(compare_fits(given, asked, judging, _listed(models), _shown(progress), check=check), given)


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
        asked.prior_of_type,
    )


def _path(given: str | Path | None) -> Path | None:
    return Path(given) if given is not None else None


def _listed(given: str | Sequence[str]) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)


def _joined(names: str | Sequence[str]) -> str:
    return names if isinstance(names, str) else ",".join(names)


def _name_of(prior: str | Path | Model | None) -> Path | None:
    if isinstance(prior, Model):
        return prior.path or _DEFAULT_PRIOR
    return Path(prior) if prior is not None else None


def _shown(progress: Progress | None) -> Callable[[str], Any] | None:
    """Reports of the check and of each fit, each from 0 to 1, to `progress`."""
    if progress is None:
        return None

    @contextmanager
    def shown(name: str) -> Iterator[Progress]:
        yield lambda doing, share: progress(": ".join(word for word in (name, doing) if word), share)

    return shown
