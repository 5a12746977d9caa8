"""KUKA controller with RSI (searches, each interpolation cycle) and an EthernetKRL channel (point-to-point moves).

What is imported here is imported by the cyclic process too: nothing.
"""
