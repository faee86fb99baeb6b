"""CDR bytes to measurements and back: the one room that both the nodes and the replay pass through.  No rclpy in here."""
