//! Motion along [`BLOCK`] samples at a time.

/// Samples of one block: long enough for vectors, short enough for the processor to begin the next
/// one meanwhile.
pub(crate) const BLOCK: usize = 32;

/// One number a sample.
pub(crate) type Samples = [f64; BLOCK];

/// Motion of one block, every sample of which a step accepts.
pub(crate) struct Motion {
    /// Δx, m.
    pub(crate) displacement: Samples,
    /// v, m/s.
    pub(crate) velocity: Samples,
}

impl Motion {
    /// From `start` (m) through `positions` (m) in `durations` (s); `None` if the step would refuse
    /// any of it.
    #[inline(always)]
    pub(crate) fn new(start: f64, positions: &Samples, durations: &Samples) -> Option<Self> {
        let mut motion = Self { displacement: [0.0; BLOCK], velocity: [0.0; BLOCK] };
        motion.displacement[0] = positions[0] - start;
        for i in 1..BLOCK {
            motion.displacement[i] = positions[i] - positions[i - 1];
        }
        let mut accepted = true;
        for i in 0..BLOCK {
            let (duration, velocity) = (durations[i], motion.displacement[i] / durations[i]);
            // The conditions of `velocity` in friction.rs, and a finite position, without a branch.
            accepted &= (duration > 0.0)
                & (duration <= f64::MAX)
                & (velocity.abs() <= f64::MAX)
                & (positions[i].abs() <= f64::MAX);
            motion.velocity[i] = velocity;
        }
        accepted.then_some(motion)
    }
}
