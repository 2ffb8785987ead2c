"""Work of the force and losses of modes, damper, friction and impacts over a segment without events, in closed form.

In: modal amplitudes and forced parts of a regime, and the segment's two ends. Out: joules, added to
the lane's account (`add_energy` of `energies.py`).
"""
