"""Filter cores: mean state, covariance and dynamics, and the views of them that aids work on."""
