"""One linear regime between two events.

The package contains modal amplitudes, their exact propagation, the forced part of a window, and the
samples of a segment.

In: tables of a regime (`regimes.py`), a load, modal amplitudes at the last event. Out: amplitudes,
and so the state, at any later time of the window; samples for the observers.
"""
