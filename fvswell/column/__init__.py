"""A column: its laws, grid and balances, and Newton's method for many of them at once."""
