"""Values that users write: poses, cameras, lights, materials, shapes. Needs no daemon."""
