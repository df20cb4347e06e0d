"""Client, Scene and Edits, which bring the folders before them together."""
