"""Periodic orbits.

The conditions at the events of an orbit are formulated by the periodic Green's function and solved
by Newton's method. The package also computes the derivative of the return map.

In: a structure as exponentials, a point of the parameters, an order of events, a first guess. Out:
phases and impulses of the events, residuals, the motion between the events, and the monodromy
matrix.
"""
