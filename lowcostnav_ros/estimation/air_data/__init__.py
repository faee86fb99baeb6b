"""The air data computer: pressures and temperature to airspeeds, with what betrays a blocked or iced pitot tube."""
