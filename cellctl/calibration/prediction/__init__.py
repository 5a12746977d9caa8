"""Predictions of an identified model, their uncertainty, and its measured region."""
