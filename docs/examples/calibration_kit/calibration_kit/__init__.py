"""Extends the calibration of cellctl."""
