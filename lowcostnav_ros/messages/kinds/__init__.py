"""Kinds of messages, one family a file: each file holds all there is to know of its topics (see :mod:`lowcostnav_ros.messages.kind`)."""
