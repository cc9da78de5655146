"""An Extended Maxwell-Slip element without seal damping while its velocity is constant, in closed form."""

import numpy


def deflected(z, velocity, duration, beta, width, low, high):
    """The deflection after `duration` from `z`; low and high: slopes of the deformation force below -width and above width."""
    left = duration
    while left > 0.0:
        outside = z > width or z < -width or (abs(z) == width and velocity * z > 0.0)
        if not outside:
            # The seal sticks until z reaches an end.
            end = width if velocity > 0.0 else -width
            reach = (end - z) / velocity if velocity != 0.0 else numpy.inf
            z = end if reach <= left else z + velocity * left
            left -= min(reach, left)
            continue
        # It slides: z - end tends to beta*v/k, and ends where that brings it back inside.
        end, k = (width, high) if z > 0.0 else (-width, low)
        settled, beyond = beta * velocity / k, z - end
        back = numpy.inf
        if settled * beyond < 0.0:
            back = beta / k * numpy.log((beyond - settled) / -settled)
        lasts = min(back, left)
        z = end if back <= left else end + settled + (beyond - settled) * numpy.exp(-k * lasts / beta)
        left -= lasts
    return z
