"""Structures from files and cyclic structures: modes from matrices and measured modes, checked."""
