"""Satellite navigation: orbits, time, observations and their errors, point positioning and its integrity.

Pure functions and small values.  Clock states are metres and metres per second with the sign of the observation: a receiver clock that
runs ahead lengthens every pseudorange, ``pseudorange = |r_satellite - r_receiver| + clock_m``.  A Doppler is the range *rate*, m/s,
positive when the satellite recedes.  Lines of sight point from the receiver to the satellite.
"""


class GnssError(ValueError):
    """Satellite data that cannot be used; the message is one sentence that says what to do."""
