"""The rows of `system.Slots.rows`: one definition for kernels and vector code.

A complex quantity has two rows, its real part and, in the next one, its imaginary part.
"""

S = 0  # eigenvalue (1/s)
SQUARE = 2  # its square
DRIVE = 4  # response to a unit force of the drive
RELATIVE = 6  # response to a unit force between beam and absorber
REST = 8  # -relative/s
GUARD = 10  # weight in the regime's guard signal
TIP = 12  # weight in the tip displacement
TAYLOR = 14  # s^n/n! for n = 1 ... TAYLOR_ROWS
TAYLOR_ROWS = 6
SPEED = TAYLOR + 2 * TAYLOR_ROWS  # |s|, real as the next two
SPEED_SQUARE = SPEED + 1
SPEED_CUBE = SPEED + 2
BASE = SPEED + 3  # response to a unit acceleration of the first base; two rows for each one more
ROWS = BASE  # of a regime under a base at rest
