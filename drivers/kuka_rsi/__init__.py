"""KUKA controller with RSI (searches, each interpolation cycle) and an EthernetKRL channel (point-to-point moves).

The cyclic process imports this module too: keep it free of imports.
"""
