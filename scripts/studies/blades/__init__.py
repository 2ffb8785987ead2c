"""Bladed disks: comparison with another program, and which blades need an absorber."""
