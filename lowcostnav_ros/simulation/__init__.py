"""Simulated flights without ROS: a scenario (text) makes a truth and the measurements of every sensor, second by second."""
