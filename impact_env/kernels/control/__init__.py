"""Control intervals of many lanes in one call, for the environments.

The kernels apply changes from outside, and do what a task does before and after an interval.

In: lanes of any family above, orders for each, and the interval's end. Out: the lanes gone on, and
numbers of the interval for features and rewards.
"""
