"""How good a model is on held-out rows, and whether its σ can be relied on."""
