//! The recordings as simulation steps for the classical models, with the scales that the
//! identification found.

use crate::options::IdentifyOptions;
use crate::result::Identification;
use crate::training::{ASSUMED_WIDTH, Coarseness, Segmented, Training};
use crate::two_steps::settled_segments;
use trocar_recording::Recording;
use trocar_recording::loads::UNLOADED;
use trocar_simulate::segment::{Segments, SteadySegment, segment};
use trocar_simulate::stick_slip::LeftOut;

use super::coordinate::Scales;

/// Most clusters of cycles. This is fewer than for the EMS element: without a steady state of its
/// own, the fit must not treat neighbouring cycles as independent.
const MOST_CLUSTERS: usize = 40;

/// Steps to simulate, and the scales of the data.
///
/// All samples have equal weights. The criterion is thus nearly the score, except for samples
/// averaged into one step (by the half width, m) and for those before the element's stages forget
/// their unknown initial state.
#[derive(Debug, Clone)]
pub struct ClassicalData {
    pub(crate) training: Training,
    /// The same in longer steps.
    pub(super) search: Training,
    pub(crate) scales: Scales,
}

impl ClassicalData {
    /// `recordings` must be free of inertia; `found` was identified from them.
    pub fn new(
        recordings: &[Recording],
        found: &Identification,
        options: &IdentifyOptions,
    ) -> Self {
        let stroke = recordings.iter().map(|r| r.quality.stroke).fold(0.0, f64::max);
        let half_width =
            if found.deformation.is_ok() { found.model.half_width } else { ASSUMED_WIDTH * stroke };
        let found_in: Vec<_> = recordings.iter().map(|r| segmented(r, found, options)).collect();
        let still: Vec<_> = recordings.iter().map(|r| vec![0.0; r.len()]).collect();
        let all = recordings.iter().zip(&found_in).zip(&still);
        let parts = all.map(|((recording, (segments, settled)), acceleration)| {
            let (strokes, settled) = (segments.strokes.as_slice(), settled.clone());
            let (recorded, left_out) = (&UNLOADED, LeftOut::NONE);
            Segmented { recording, strokes, settled, acceleration, recorded, left_out }
        });
        let parts: Vec<Segmented> = parts.collect();
        let of = |coarseness| {
            let mut training =
                Training::new(&parts, half_width, MOST_CLUSTERS, f64::INFINITY, coarseness);
            training.forget_unknown_starts(found.stages);
            training
        };
        let [training, search] = [Coarseness::NONE, Coarseness::SEARCH].map(of);
        let scales = Scales {
            offset: found.model.offset,
            force: found.model.insertion.coulomb_force,
            viscous: found.model.insertion.viscous_damping,
            half_width,
            stroke,
            speeds: found.steady.speed_range_m_s,
        };
        Self { training, search, scales }
    }
}

fn segmented(
    recording: &Recording,
    found: &Identification,
    options: &IdentifyOptions,
) -> (Segments, Vec<SteadySegment>) {
    let segments = segment(recording, &options.segment);
    let settled = match &found.deformation {
        Ok(deformation) => settled_segments(recording, &segments, &found.steady, deformation),
        Err(_) => Vec::new(),
    };
    (segments, settled)
}
