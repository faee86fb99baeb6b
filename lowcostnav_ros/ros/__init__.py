"""What every node shares: quality of service, parameters, diagnostics, start and stop.  The only layer that imports rclpy."""
