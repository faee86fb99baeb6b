"""A page that shows the flight of a running graph: what it shows, and the server that sends it to browsers; no ROS."""
