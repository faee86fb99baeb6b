"""Noise numbers of a navigator from recordings: maximum likelihood of its own innovations."""
