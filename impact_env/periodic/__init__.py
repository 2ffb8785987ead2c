"""Periodic orbits of a beam with an impact absorber: closed forms, event schedules, stability. docs/frequency_domain.md explains them."""
