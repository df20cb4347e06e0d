"""Robots of URDF files."""
