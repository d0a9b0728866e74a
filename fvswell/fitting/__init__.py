"""Properties from measured curves, how sure they are, and which experiment tells most."""
