"""The version, in a module that imports nothing: the package itself only leads to its public names."""

__version__ = "0.1.0"
