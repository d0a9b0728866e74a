"""Numerics that know no tissue: protocols, time stepping, what it asks of a system, conservation, linear algebra."""
