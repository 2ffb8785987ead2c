"""Energies over a segment without events, in closed form.

They are the work of the force and the losses of modes, damper, friction and impacts.

In: modal amplitudes and forced parts of a regime, and the segment's two ends. Out: joules, added to
the lane's account (`add_energy` of `energies.py`).
"""
