"""The executables: one thin file per node."""
