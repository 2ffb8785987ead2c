"""The search for the next event: where a guard signal leaves its bounds, or its rate changes sign. None is missed.

In: a signal as a sum over slots and a polynomial (`Course`), and what ends it (`Guards`). Out: an `Event`, or that there is none.
"""
