"""The faults, by what goes wrong: the stream, the values, units and axes, the clocks; and what one sensor alone can do."""
