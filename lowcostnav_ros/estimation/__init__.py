"""The Kalman machinery every navigator shares; numpy and compiled kernels only."""
