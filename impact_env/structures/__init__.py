"""Structures that are not a beam of `impact_env.Beam`: modes from matrices, measured modes from Universal Files, and checks of both."""
