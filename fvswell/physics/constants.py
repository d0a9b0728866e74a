"""Physical constants in the internal units: mm, N, s, mmol, K, C (so MPa and mV)."""

GAS_CONSTANT = 8.314462618  # N mm / (mmol K)
FARADAY = 96.48533212  # C / mmol
