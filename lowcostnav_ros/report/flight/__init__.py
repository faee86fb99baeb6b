"""The page of a flight: map, errors in their sigmas, modes, tables."""
