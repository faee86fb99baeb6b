"""Navigators: each a chosen list of state blocks and aids behind one verb, ``feed``."""
