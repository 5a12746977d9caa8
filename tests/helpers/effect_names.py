"""Names of what an effect may change."""

from cellctl.calibration import Effect


def names_of(effect: Effect) -> tuple[str, ...]:
    """Of its amounts (K,), in their order."""
    return tuple(parameter.name for parameter in effect.parameters)
