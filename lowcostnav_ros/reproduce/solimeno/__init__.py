"""Results of Solimeno (2007), one function a result."""
