"""Scenes as GLB files."""
