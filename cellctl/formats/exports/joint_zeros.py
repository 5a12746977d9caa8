"""Joint zeros, base and tool alone that come nearest to a model: what a controller takes without an option."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from cellctl.formats.exports.fitted_forms import fitted_zeros

if TYPE_CHECKING:
    from cellctl.formats.exports.fitted_forms import FittedForm
    from cellctl.formats.exports.left_out import Cost
    from cellctl.formats.model import ModelFile
    from cellctl.kinematics import Floats


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
    import numpy as np

    from cellctl.compensation import zeros_of

    form = fitted_zeros(model)
    return JointZeros(model.robot.joint_map().sign * np.rad2deg(zeros_of(form.chain)) + 0.0, form)
