"""fvswell: finite-volume swelling and compression of soft, charged, hydrated tissues."""

__version__ = "0.1.0"
