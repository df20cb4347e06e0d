"""Scenes as files of others: scene.export(). docs/formats.md, "Writing"."""
