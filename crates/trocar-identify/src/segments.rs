//! A recording divided into strokes and constant-velocity segments.

use trocar_recording::Recording;
use trocar_simulate::segment::{
    SegmentOptions, SteadySegment, Stroke, reversal_threshold, steady_segments, strokes,
};

/// Strokes and constant-velocity segments of one recording.
pub(super) struct Segments {
    pub(super) strokes: Vec<Stroke>,
    pub(super) steady_segments: Vec<SteadySegment>,
}

impl Segments {
    /// The constant-velocity segments of each velocity plateau.
    pub(super) fn plateaus(&self) -> impl Iterator<Item = &[SteadySegment]> {
        self.steady_segments.chunk_by(|a, b| a.plateau == b.plateau)
    }
}

pub(super) fn segment(recording: &Recording, options: &SegmentOptions) -> Segments {
    let strokes = strokes(recording, reversal_threshold(recording));
    let steady_segments = steady_segments(recording, &strokes, options);
    Segments { strokes, steady_segments }
}
