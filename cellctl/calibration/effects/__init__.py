"""What a robot does besides its geometry: each effect turns its joints, or shifts its tool, in proportion to amounts."""

from cellctl.calibration.effects.effect import Effect

__all__ = ["Effect"]
