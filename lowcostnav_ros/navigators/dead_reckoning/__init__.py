"""DME-aided dead reckoning."""
