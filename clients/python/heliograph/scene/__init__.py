"""Content of a scene: handles, and the messages that edits and queries are made of."""
