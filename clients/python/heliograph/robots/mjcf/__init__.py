"""Scenes and robots of MJCF files, read by MuJoCo's own compiler."""
