"""Periodic orbits: conditions at their events by the periodic Green's function, Newton's method, the return map's derivative.

In: a structure as exponentials, an order of events, a first guess. Out: times and impulses of the
events, residuals, and the monodromy matrix.
"""
