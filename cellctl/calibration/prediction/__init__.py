"""Predictions of an identified model, and their uncertainty."""
