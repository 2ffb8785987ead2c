"""The search for the next event: where a guard signal leaves its bounds, or its rate changes sign. None is missed.

In: a signal as a sum over modal amplitudes and a polynomial (`EventFunction`), and what ends it
(`Guards`). Out: an `GuardEvent`, or that there is none.
"""
