"""Results of Eggers (1995): GPS-aided navigation without an inertial unit."""
