"""Results of the theses this package implements, computed again beside the printed numbers, with a verdict each."""
