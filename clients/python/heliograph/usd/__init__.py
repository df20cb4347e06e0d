"""USD stages as edits. Only edits.py is imported without pxr, the package usd-core."""
