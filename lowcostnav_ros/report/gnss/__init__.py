"""Pages, figures and tables of satellite plans and of positions out of a receiver's files."""
