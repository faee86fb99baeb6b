"""Pages, figures and tables of a DME plan."""
