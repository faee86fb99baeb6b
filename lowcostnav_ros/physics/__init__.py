"""The earth, rotations, the strapdown step, stochastic processes, the atmosphere, the magnetic field: pure functions and small values."""
