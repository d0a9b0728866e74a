"""Case files: what can be said, reading and checking it, and the errors told."""
