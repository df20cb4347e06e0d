"""Pictures: view transforms, drawings on frames, files, what notebooks show."""
