"""Tables, lines and figures for people."""
