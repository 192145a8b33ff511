"""The delayed horizon: samples are fused at their own times, and a predictor gives the estimate of the present.

The filter runs so far behind the newest inertial sample that a late measurement is there when its time comes: inputs
wait in a ring, measurements in a queue. A step of the filter is divided where a measurement's time is within it, so
that each is fused at its time; order of arrival does not matter. A second state, the present one, is integrated from
the newest inputs with the filter's biases, and is drawn to the filter by what the two differ at the horizon [1]_.

References
----------
.. [1] A. Khosravian, J. Trumpf, R. Mahony, T. Hamel, Recursive attitude estimation in the presence of multi-rate and
   multi-delay vector measurements, American Control Conference, 2015.
"""
