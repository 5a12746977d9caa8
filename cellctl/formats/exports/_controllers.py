"""Joint zeros, tool and base nearest to a model, as a person enters them at a KUKA, ABB or FANUC controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.compensation import zeros_of
from cellctl.formats.dataset import text_of
from cellctl.formats.exports._fitted_forms import Cost, FittedForm, fitted_zeros
from cellctl.formats.model import ModelFile
from cellctl.kinematics import Floats, abc_from_rotation, inverse_pose
from cellctl.krl.writing import aggregate_text


@final
@dataclass(frozen=True, eq=False)
class JointZeros:
    """offsets (n,), deg: the controller's readings at the same posture must grow by these; the first and last are 0.

    form: the chain that they go with, and its distance from the model.
    """

    offsets: Floats
    form: FittedForm

    @property
    def base(self) -> Floats:
        """Base in the measuring frame (4, 4), mm, that goes with the offsets."""
        return self.form.chain.base_now

    @property
    def tool(self) -> Floats:
        """TCP in the flange frame (4, 4), mm, that goes with the offsets."""
        return self.form.chain.tool_now

    @property
    def before(self) -> Cost:
        """Distance from the model where base and tool alone are set."""
        return self.form.nominal

    @property
    def after(self) -> Cost:
        """Distance from the model with the offsets too."""
        return self.form.cost


def joint_zeros(model: ModelFile) -> JointZeros:
    """Those of `cellctl compensate --method write-back-zeros`, over the model's measured postures.

    A joint's zero is found with all else that the controller cannot take (lengths, angles of axes, effects) held at the
    robot file's values; so it is not the parameter of the model, but the offset that leaves the smallest error.
    """
    form = fitted_zeros(model)
    return JointZeros(model.robot.joint_map().sign * np.rad2deg(zeros_of(form.chain)) + 0.0, form)


DECIMALS_DEG = 5


def kuka_text(name: str, zeros: JointZeros, tool: int, base: int) -> str:
    """Lines for `$CONFIG.DAT` (TOOL_DATA and BASE_DATA of these numbers), with the mastering offsets as comments.

    BASE_DATA is the measuring frame in the robot's root frame: it holds where `$ROBROOT` is zero.
    """
    last = len(zeros.offsets)
    held = {1: f"held by BASE_DATA[{base}]", last: f"held by TOOL_DATA[{tool}]"}
    rows = [
        f"; A{axis}  {offset:+.{DECIMALS_DEG}f}" + (f"  ({held[axis]})" if axis in held else "")
        for axis, offset in enumerate(zeros.offsets.tolist(), 1)
    ]
    lines = [
        f"; {' '.join(name.split())}: mastering offsets, tool and base.",
        "; They belong together: enter all of them, or none.",
        f"; Distance from the model: {zeros.before.words}, with tool and base alone;",
        f"; {zeros.after.words}, with the offsets too.",
        ";",
        "; Mastering offsets, degrees: the axis at the same place reads more by this after mastering.",
        "; Move the axis to the reading $MAMES[axis] minus its offset, and master it there.",
        *rows,
        ";",
        "; For $CONFIG.DAT. BASE_DATA is in the robot's root frame: $ROBROOT is zero.",
        f"TOOL_DATA[{tool}]={_krl_frame(zeros.tool)}",
        f"BASE_DATA[{base}]={_krl_frame(inverse_pose(zeros.base))}",
    ]
    return "".join(f"{line}\n" for line in lines).encode("ascii", "replace").decode()


def abb_text(zeros: JointZeros) -> str:
    """A table for the fine calibration of each axis: at `move_to_deg` the axis is at its calibration position 0."""
    return text_of(
        [
            {"axis": axis, "offset_deg": offset, "move_to_deg": 0.0 - offset}
            for axis, offset in enumerate(_rounded(zeros), 1)
        ]
    )


def fanuc_text(zeros: JointZeros) -> str:
    """A table for the single axis mastering of each joint: `master_at_zero_deg` is MSTR POS where it reads 0.

    The controller shows J3 from the horizontal, so that its reading is that of the robot file less that of J2.
    """
    offsets = _rounded(zeros)
    shown = [offset - (offsets[1] if joint == 3 else 0.0) for joint, offset in enumerate(offsets, 1)]
    return text_of(
        [
            {
                "joint": joint,
                "offset_deg": offset,
                "shown_offset_deg": round(both, DECIMALS_DEG),
                "master_at_zero_deg": round(both, DECIMALS_DEG),
            }
            for joint, (offset, both) in enumerate(zip(offsets, shown, strict=True), 1)
        ]
    )


def _rounded(zeros: JointZeros) -> list[float]:
    return [round(value, DECIMALS_DEG) + 0.0 for value in zeros.offsets.tolist()]


def _krl_frame(matrix: Floats) -> str:
    values = [*matrix[:3, 3].tolist(), *abc_from_rotation(matrix[:3, :3]).tolist()]
    return aggregate_text(dict(zip("XYZABC", values, strict=True)))
