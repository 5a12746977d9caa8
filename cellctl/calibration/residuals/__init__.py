"""Residual models: random functions of the posture for what no other effect explains."""
