"""Predictions of an identified robot's TCP."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from cellctl.facade.arrays import postures
from cellctl.facade.frames import by_index, columns_of, data_set_of, frame_of, is_frame
from cellctl.files import InputError, write_atomically
from cellctl.formats import DataSet, ModelFile

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cellctl.kinematics import Bools, Floats
    from cellctl.operations.predicting import Predicted


@final
@dataclass(frozen=True, eq=False, repr=False)
class Prediction:
    """Predicted TCPs of N postures, in the model's frame (the instrument's, or that of the touched spheres).

    joints (N, n): controller readings, deg. poses (N, 4, 4), positions (N, 3): mm. sigma_mm (N,): 1 σ, 3-D, in the
    `frame` that was asked for; the same in both where an instrument measured.
    sigma_among_mm (N,): 1 σ relative to each other, without common rigid motions; NaN for fewer than four postures.
    inside (N,): within the measured region; outside it the model extrapolates, with a larger σ.
    """

    joints: Floats
    poses: Floats
    sigma_mm: Floats
    sigma_among_mm: Floats
    inside: Bools
    _rows: Predicted

    @property
    def positions(self) -> Floats:
        """TCP positions (N, 3), mm."""
        return self.poses[:, :3, 3]

    def __len__(self) -> int:
        return len(self.poses)

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """The columns of `cellctl predict`: A1…An (deg), X, Y, Z (mm), A, B, C (deg), sigma, sigma_among (mm), seen."""
        return columns_of(self._rows.records())

    def to_frame(self) -> Any:
        """The same as a pandas DataFrame."""
        return frame_of(self.to_dict())

    def to_csv(self, path: str | Path) -> None:
        """Write the file that `cellctl predict -o` writes. Raises OSError."""
        write_atomically(Path(path), self._rows.text())

    def __repr__(self) -> str:
        return f"<cellctl prediction: {len(self)} postures, {int((~self.inside).sum())} outside the measured region>"

    def _repr_html_(self) -> str:
        from cellctl.facade.views import prediction_view

        return prediction_view(self)


def predicted(model: ModelFile, q: Any, frame: str) -> Prediction:
    """See `Model.predict`."""
    import numpy as np

    from cellctl.operations.predicting import predict_rows

    try:
        found = predict_rows(model, _joints(model, q), frame=frame)
    except InputError as error:
        if isinstance(q, str | Path):
            raise
        raise by_index(error) from error
    for words in found.assumed:
        warnings.warn(words, stacklevel=3)
    among = found.sigma_among_mm if found.sigma_among_mm is not None else np.full(len(found.poses), np.nan)
    return Prediction(found.readings, found.poses, found.sigma_mm, among, found.inside, found)


def _joints(model: ModelFile, q: Any) -> DataSet:
    if isinstance(q, str | Path):
        return DataSet.load(Path(q))
    if is_frame(q) or isinstance(q, Mapping):
        return data_set_of(q, "q")
    names = [f"A{number}" for number in range(1, model.robot.n + 1)]
    rows = postures(q, model.robot.n).tolist()
    return DataSet.of_records([dict(zip(names, row, strict=True)) for row in rows], "q")
