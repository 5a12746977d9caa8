"""Residual models: random functions of the posture for errors that no other effect explains."""
