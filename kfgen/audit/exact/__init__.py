"""What no measurement can tell, as a fact and not by a tolerance: null spaces of the observability of a model.

A null space is found in four ways, each for what the one before leaves open:

1. ``modular`` (whole numbers modulo one prime, 64 bits): which states can take part at all, and how many orders of the power
   series matter. Fast, but a prime may divide a minor by accident, so it only narrows the search.
2. ``chain`` on ``padic`` (whole numbers modulo a power of a prime): the null space along a whole manoeuvre, exact for almost
   every duration of its segments. This is the answer; ``basis`` makes it readable, its amounts fractions where they are.
3. ``value_columns`` (floating point): amounts that are no fractions, of states that are known from 2.
4. ``symbolic`` (sympy): the amounts in the model's parameters, where nothing changes with time.

``plan`` writes F and H of a model down, ``power_series`` and ``segment_series`` evaluate them along a segment of a manoeuvre,
``transport`` carries a direction from the start of one manoeuvre to that of another.
"""
