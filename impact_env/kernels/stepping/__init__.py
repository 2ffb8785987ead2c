"""The stepping methods.

They are Moreau's method with the rigid contact laws, and the Runge-Kutta method with the contact
laws that are springs.

In: modes, laws and the force at equidistant times. Out: as of the exact method, with its observers.
"""
