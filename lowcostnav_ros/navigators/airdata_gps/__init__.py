"""GPS and air data, without an inertial unit."""
