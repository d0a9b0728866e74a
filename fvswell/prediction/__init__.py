"""How far the models of a case are apart, from the exact linear solution, without a run."""
