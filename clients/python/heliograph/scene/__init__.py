"""What a scene holds: handles, and the messages that edits and queries are made of."""
