"""The stepping methods: Moreau's with the rigid contact laws, and the Runge-Kutta method with those that are springs.

In: modes, laws and the force at equidistant times. Out: as of the exact method, with its observers.
"""
