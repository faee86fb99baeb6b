"""Radio navigation: DME stations, interrogation, ranges and their geometry."""
