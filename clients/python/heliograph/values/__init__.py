"""What users write down: poses, cameras, lights, materials, shapes. Needs no daemon."""
