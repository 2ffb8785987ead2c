"""Compilation and caching of kernels, and their execution without numba.

This package contains the decorators, the language for vector code, records, and the cache.

In: a function, and the types of its arguments. Out: machine code, loaded from the cache if it has
been compiled before. No file of this package contains mechanics.
"""
