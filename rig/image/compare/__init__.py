"""One capture by all methods that can image it, at the same resolution, measured alike."""
