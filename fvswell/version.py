"""The version of the package, by itself so that any module may ask for it."""

__all__ = ["__version__"]

__version__ = "0.1.0"
