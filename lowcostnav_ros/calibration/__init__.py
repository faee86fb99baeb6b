"""Calibration and identification of sensors from recorded samples: pure mathematics, no files and no plots."""
