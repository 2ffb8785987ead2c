"""The exact method: one loop over windows and events for each kind of scene - linear, rigid, with springs, several absorbers - and its contact laws.

In: a scene of arrays and records, a schedule, a lane's state, and what is observed. Out: the state
at the end, what was observed, a status.
"""
