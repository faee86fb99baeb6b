"""Would it have survived losing GPS here? Every start of a flight at once."""
