"""One linear regime between two events: slots, their exact propagation, the forced part of a window, and the samples of a stretch.

In: tables of a regime (`regimes.py`), the pieces of the load, the state at the last event. Out: the state at any later time of the window.
"""
