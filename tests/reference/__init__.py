"""Independent references: slow, plain, and without anything of the methods that they judge.

``contact`` holds the one contact mechanics, ``mechanics`` the equations. ``dense`` follows a scene
by matrix exponentials in double precision, ``digits`` by Taylor series with 40 right digits;
``replay`` checks the events that a run lists, and ``stepping`` has Moreau's scheme. ``motion`` has
matrix exponentials with 40 digits, and ``signals`` finds first events by brute force.
"""
