"""Studies: thousands of columns, from a table of parameters to one result."""
