"""Pictures: view transforms, drawings on frames, files, HTML for notebooks."""
