"""How good the answers of `design_gap` are: twenty structures, and fine scans of their gaps."""
