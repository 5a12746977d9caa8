"""Drivers: one package per device, with the production codec of its protocol."""
