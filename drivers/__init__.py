"""Drivers: one package per device, the production codec of its wire."""
