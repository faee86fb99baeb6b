"""The page of a study of outages."""
