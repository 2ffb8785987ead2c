"""Structures that are not a beam of `impact_env.Beam`.

They have modes from matrices or measured modes from Universal Files. Both are checked.
"""
