"""Periodic responses: exact orbits, harmonic balance, and the continuation of both."""
