"""The stepping methods.

They are Moreau's method with the rigid contact laws, and the Runge-Kutta method with the compliant
contact laws.

In: modes, laws, breakpoints of the drive, the initial state, a time step. Out: the final state, a
status code, and the filled observers, which are those of the exact method.
"""
