"""The search for the next event.

At an event a guard signal leaves its bounds, or its rate changes sign. No event is missed.

In: a signal as a sum over modal amplitudes and a polynomial (`EventFunction`), and what ends it
(`Guards`). Out: a `GuardEvent`, whose kind is NOTHING if no event occurs.
"""
