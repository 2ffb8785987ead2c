"""Work of the force and losses of modes, damper, friction and impacts over a stretch without events, in closed form.

In: slots and forced parts of a regime, and the stretch's two ends. Out: joules, added to the lane's account (`add_energy` of `energies.py`).
"""
