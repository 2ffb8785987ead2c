"""Control intervals of many lanes in one call, for the environments.

The kernels apply changes from outside, and do what a task does before and after an interval.

In: lanes of a scene, in memory that is kept between intervals, and an order for each. Out: the
lanes at the interval's end, and a report of each, for features and rewards.
"""
