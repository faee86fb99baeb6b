"""The supervisor: which solution is flown, and why."""
