"""Scenes and robots of MJCF files, by what MuJoCo's own compiler makes of them."""
