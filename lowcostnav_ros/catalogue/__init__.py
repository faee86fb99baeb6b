"""From names and files to things: settings, IMU profiles, station tables, almanacs, scenarios, and navigators as configured."""
