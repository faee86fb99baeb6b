"""What everything stands on: compiled kernels, small matrices, units, settings, measurements, truth, seeds.  Imports nothing of ours."""
