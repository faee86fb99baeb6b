"""Aids: one file a sensor, with its settings, state blocks, inputs, innovation and recovery, shared by all navigators."""
