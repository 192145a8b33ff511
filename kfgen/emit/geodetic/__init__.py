"""Latitude, longitude and height at the border of a filter in a local level frame: in double precision, whatever its own is.

The first fix sets the origin. From then on north is the change of latitude times the radius of the meridian there, east
that of longitude times the radius of the parallel, down that of height: what comes in comes out again, to the rounding
of the filter's numbers. Where the filter itself is farther off than `MAX_DISTANCE`, the origin moves to it.
"""
