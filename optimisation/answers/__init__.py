"""Whole answers: what a command prints, draws and writes, from Python."""
