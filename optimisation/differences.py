"""The first place where two descriptions in plain data differ."""

from __future__ import annotations


def difference(held: object, wanted: object, path: str = "") -> str:
    """Name the first place where two descriptions of JSON values differ."""
    if isinstance(held, dict) and isinstance(wanted, dict):
        for key in sorted({*held, *wanted}):
            if held.get(key) != wanted.get(key):
                return difference(held.get(key), wanted.get(key), f"{path}.{key}" if path else key)
    if isinstance(held, list) and isinstance(wanted, list) and len(held) == len(wanted):
        for k, (a, b) in enumerate(zip(held, wanted, strict=True)):
            if a != b:
                return difference(a, b, f"{path}[{k}]")
    return f"{path or 'identity'} is {held!r} there and {wanted!r} here"
