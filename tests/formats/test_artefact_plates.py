"""The plate under an artefact's spheres, as the cell file says it."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellctl.files import InputError
from cellctl.formats import load_artefact


def written(folder: Path, plate: str) -> Path:
    path = folder / "artefact.yaml"
    path.write_text(f"{plate}\nspheres:\n  - {{id: S1, diameter: 60, centre: [900, 0, 300]}}\n")
    return path


def test_a_plate_has_a_height_and_stems_of_eight_millimetres_unless_said_otherwise(tmp_path: Path) -> None:
    plate = load_artefact(written(tmp_path, "plate: {z: 100}")).plate
    assert plate is not None
    assert (plate.z, plate.stem_radius) == (100.0, 8.0)


def test_a_plate_may_be_left_out(tmp_path: Path) -> None:
    assert load_artefact(written(tmp_path, "tip_radius: 1")).plate is None


def test_a_sphere_that_sinks_into_the_plate_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="sphere 'S1' is not above the plate"):
        load_artefact(written(tmp_path, "plate: {z: 280}"))
