"""Campaigns and covariance studies over the navigators' own models; what a thesis computes without flying it."""
