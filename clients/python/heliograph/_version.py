"""The version of this client. Imports nothing, so that any module may ask for it."""

__version__ = "0.1.0"
