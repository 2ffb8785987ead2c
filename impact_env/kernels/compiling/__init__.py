"""Compilation and caching of kernels, and their execution without numba.

This package contains the decorators, the language for vector code, records, and the cache.

In: a function's source, and the types of what it is called with. Out: machine code, from the cache
where it is kept. Nothing here knows of mechanics.
"""
