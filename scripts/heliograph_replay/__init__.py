"""Reads recordings of a daemon and plays them again: scripts/replay. Imports heliograph."""
