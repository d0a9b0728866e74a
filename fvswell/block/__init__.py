"""A block in two dimensions: its grid, mechanics and transport, and Newton's method for it."""
