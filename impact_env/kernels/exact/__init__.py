"""The exact method: one loop over windows and events for each kind of scene.

The kinds are linear scenes, rigid contact, contact with springs, and several absorbers. The package
contains their contact laws as well.

In: a scene of arrays and records, a schedule, a lane's state, and what is observed. Out: the state
at the end, what was observed, a status.
"""
