"""How a navigator begins: levelling, the first attitude, a point solution of satellites, another navigator's state."""
