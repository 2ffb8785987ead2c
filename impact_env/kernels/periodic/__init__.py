"""Periodic orbits.

The conditions at their events are formulated by the periodic Green's function and solved by
Newton's method. The package also computes the derivative of the return map.

In: a structure as exponentials, an order of events, a first guess. Out: times and impulses of the
events, residuals, and the monodromy matrix.
"""
