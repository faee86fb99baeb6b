"""Sensors: for each a profile (data-sheet numbers), an error model and a simulator with one verb, ``simulate(truth)``."""
