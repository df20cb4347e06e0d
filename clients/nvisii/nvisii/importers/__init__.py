"""Empty, as in NViSII: nvisii.import_scene() imports."""
