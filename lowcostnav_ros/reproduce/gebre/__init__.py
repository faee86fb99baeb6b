"""Results of Gebre-Egziabher (2004), one function a result."""
