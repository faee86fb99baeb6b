"""The attitude and heading reference and its filters."""
