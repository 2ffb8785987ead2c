"""Parameters of an absorber from a measured response, with their uncertainty.

The method is simulation-based inference on statistics of ensembles.
"""
