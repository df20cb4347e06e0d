"""Scenes as USDZ files. Needs pxr."""
