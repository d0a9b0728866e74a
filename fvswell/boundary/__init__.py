"""The boundary of a body: its parts, and the conditions and loads on them, in one vocabulary for all geometries."""
