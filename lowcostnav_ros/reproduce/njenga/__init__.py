"""Results of the thesis on a low-cost MEMS AHRS and GPS."""
