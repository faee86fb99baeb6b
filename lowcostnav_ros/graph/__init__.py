"""A graph of nodes: its description, what each node needs, its processes, its life on a terminal."""
