"""Meshes by formula, as Surfaces; the vertex counts are those of a tensor product of segments."""
