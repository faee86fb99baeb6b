"""The fault study: one flight, every fault injected into a copy of it, all navigators, a verdict for each."""
