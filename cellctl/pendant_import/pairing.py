"""Pairing of postures and positions: by name, or by order where no rows can be shifted."""

from __future__ import annotations

from cellctl.pendant_import.by_name import paired_by_name
from cellctl.pendant_import.by_order import paired_by_order
from cellctl.pendant_import.choices import Choices
from cellctl.pendant_import.pairs import Pairing
from cellctl.pendant_import.points import PointList


def paired(joints: PointList, positions: PointList, choices: Choices) -> Pairing:
    """Postures with their positions: as the user chose, else by name where both have names, else by order.

    Raises InputError where it is not certain which belong together.
    """
    how = choices.pair or ("name" if joints.named and positions.named else "order")
    if how == "name":
        return paired_by_name(joints, positions, repeats=choices.repeats)
    return paired_by_order(joints, positions, asked=choices.pair == "order")
