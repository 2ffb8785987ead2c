"""Parameters of an absorber from a measured response, with their uncertainty: simulation-based inference on statistics of ensembles."""
