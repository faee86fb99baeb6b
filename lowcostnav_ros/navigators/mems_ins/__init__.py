"""Position and velocity from an attitude reference with accelerometers, and GPS."""
