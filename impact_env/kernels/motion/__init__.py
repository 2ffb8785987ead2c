"""One linear regime between two events.

The package contains modal amplitudes, their exact propagation, the forced part of a window, and the
samples of a segment.

In: tables of a regime (`regimes.py`), the pieces of the load, the state at the last event. Out: the
state at any later time of the window.
"""
