"""Replay: a recording, or any stream of measurements, through the same navigators that fly; statistics; a verdict.

``replay_bag`` and ``replay_stream`` (module :mod:`.session`) are the two verbs; :mod:`.campaign` repeats the second over many cases.
"""
