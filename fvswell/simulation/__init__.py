"""From a case to its result: a batch of columns, a column, a block."""
