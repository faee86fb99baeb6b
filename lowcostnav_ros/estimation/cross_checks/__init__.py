"""Cross-checks: do the sources of a navigator agree with each other, whatever its filter makes of them?

Each check is fed with measurements in order of their stamps, keeps little and holds :class:`~.latch.Latch` es: a contradiction begins when
two sources have disagreed for some seconds and ends when they have agreed for some.
"""
