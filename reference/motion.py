"""Motions of the reference trajectories: straight lines between samples, times in s, positions in m.

A motion is a list of legs (displacement, duration, samples); a leg without displacement is a hold.
"""

GOLDEN_RATIO = 0.6180339887498949


def move(displacement, speed, samples):
    """A leg at constant speed, m/s > 0."""
    return displacement, abs(displacement) / speed, samples


def hold(duration, samples):
    """A leg at rest."""
    return 0.0, duration, samples


def sampled(legs):
    """Times and positions of a motion from 0; a hold repeats its position to the last bit."""
    times, positions = [0.0], [0.0]
    for displacement, duration, samples in legs:
        start, origin = times[-1], positions[-1]
        for k in range(1, samples + 1):
            times.append(start + duration * (k / samples))
            positions.append(origin + displacement * (k / samples))
    return times, positions


def intervals(times, positions):
    """(displacement, duration, velocity) between samples, as anybody computes them from the file."""
    steps = []
    for k in range(len(times) - 1):
        displacement, duration = positions[k + 1] - positions[k], times[k + 1] - times[k]
        steps.append((displacement, duration, displacement / duration))
    return steps


def nested(length, speed):
    """Long slides, partial reversals, loops within loops that close and are wiped out, holds; speeds 1 : 400."""
    second = length / speed
    return [
        move(3.0 * length, speed, 40),
        hold(0.3 * second, 4),
        move(-0.50 * length, 0.3 * speed, 20),
        move(0.30 * length, 1.1 * speed, 14),
        move(-0.20 * length, 2.3 * speed, 10),
        move(0.11 * length, 0.9 * speed, 8),
        move(-0.06 * length, 0.45 * speed, 6),
        hold(0.7 * second, 3),
        move(0.06 * length, 0.6 * speed, 6),
        move(0.80 * length, 0.8 * speed, 24),
        move(0.40 * length, 0.02 * speed, 12),
        move(-2.6 * length, 3.7 * speed, 40),
        hold(2.0 * second, 5),
        move(-0.70 * length, 0.21 * speed, 18),
        move(0.25 * length, 1.3 * speed, 12),
        move(-0.25 * length, 0.7 * speed, 12),
        hold(0.1 * second, 2),
        move(1.9 * length, 0.05 * speed, 40),
        move(1.2 * length, 8.0 * speed, 24),
        hold(1.0 * second, 2),
        move(0.33 * length, 1.7 * speed, 9),
        move(-1.4 * length, 0.55 * speed, 16),
    ]


def coarse(length, speed, legs=240):
    """Every sample a reversal or a change of speed: strokes of -length to length, each a single interval."""
    motion = []
    for k in range(1, legs + 1):
        stroke = 2.0 * (k * GOLDEN_RATIO % 1.0) - 1.0
        factor = 0.05 + 4.0 * (k * GOLDEN_RATIO * GOLDEN_RATIO % 1.0) ** 3
        if k % 9 == 0:
            motion.append(hold(0.2 * length / speed, 1))
        else:
            motion.append(move(stroke * length, factor * speed, 1))
    return motion


def creep(length, speed, shrink):
    """One slide in five samples, then the nested motion `shrink` times smaller."""
    return [move(3.0 * length, speed, 5)] + nested(length * shrink, speed * shrink)
