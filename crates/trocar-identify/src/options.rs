//! Options of the identification.

use std::fmt;
use std::num::NonZeroUsize;

use super::findings::IdentifyError;
use super::kept::Kept;
use super::seal_prior::SealPrior;
use super::terms::Term;
use trocar_simulate::segment::SegmentOptions;

/// Options of the identification.
#[derive(Debug, Clone)]
pub struct IdentifyOptions {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Degrees of the two joined polynomials, 2 to 7 (EMS (25): 4 and 4).
    pub degrees: [usize; 2],
    /// Whether to try the terms that only rests and partial reversals reveal: creep, relaxation,
    /// minor loops, a second stage.
    pub free_motion: bool,
    /// Optional terms that are not tried.
    pub without: Vec<Term>,
    /// Whether to fit the position-dependent force where strokes repeat.
    pub along: bool,
    /// Whether to estimate a mass between sensor and seal that was not declared.
    pub estimate_unmodelled_mass: bool,
    /// Whether the inertia of the moving mass was removed from the readings. Transients then count
    /// as sliding too, where the deformation is less than a hundredth of the stroke.
    pub inertia_removed: bool,
    /// Sensor reading without load, N, where it is known (a tare); `None` estimates it.
    pub offset: Option<f64>,
    /// Parameters that are kept at a value or within a range.
    pub kept: Kept,
    /// Radius of the shaft in the seal, m, to identify its resistance to rotation from recordings
    /// with an angle; `None` identifies along the axis only.
    pub shaft_radius: Option<f64>,
    /// Whether to use only the procedure of the paper.
    pub paper: bool,
    /// A model of the same trocar type, whose parameters the recordings update.
    pub prior: Option<SealPrior>,
    /// Number of posterior draws; `None` takes none.
    pub posterior: Option<Draws>,
    /// Tolerances of the segmentation.
    pub segment: SegmentOptions,
}

impl Default for IdentifyOptions {
    fn default() -> Self {
        Self {
            seed: 1,
            degrees: [4, 4],
            free_motion: true,
            without: Vec::new(),
            along: true,
            estimate_unmodelled_mass: true,
            inertia_removed: false,
            offset: None,
            kept: Kept::default(),
            shaft_radius: None,
            paper: false,
            prior: None,
            posterior: None,
            segment: SegmentOptions::default(),
        }
    }
}

impl IdentifyOptions {
    /// Whether the options can be used together.
    pub(super) fn check(&self) -> Result<(), IdentifyError> {
        if self.kept.is_empty() {
            return Ok(());
        }
        let is_alone = !self.paper && self.prior.is_none() && self.posterior.is_none();
        match is_alone && self.without.iter().all(|term| !term.is_kept(&self.kept)) {
            true => Ok(()),
            false => Err(IdentifyError::Kept(self.kept.to_string())),
        }
    }

    /// All options but the tolerances of the segmentation, in words.
    pub fn in_words(&self) -> String {
        let yes_no = |value: bool| if value { "yes" } else { "no" };
        let without: Vec<&str> = self.without.iter().map(|term| term.name()).collect();
        format!(
            "seed {}, degrees {},{}, offset {}, the paper's procedure alone {}, terms of free motion {}, \
             terms not tried: {}, position profile {}, unmodelled mass {}{}{}{}{}",
            self.seed,
            self.degrees[0],
            self.degrees[1],
            self.offset.map_or_else(|| "estimated".to_owned(), |offset| format!("{offset} N")),
            yes_no(self.paper),
            yes_no(self.free_motion),
            if without.is_empty() { "none".to_owned() } else { without.join(", ") },
            yes_no(self.along),
            yes_no(self.estimate_unmodelled_mass),
            self.shaft_radius.map_or_else(String::new, |r| format!(", shaft of {} mm", 2e3 * r)),
            if self.kept.is_empty() { String::new() } else { format!(", kept: {}", self.kept) },
            self.prior.as_ref().map_or_else(String::new, |prior| format!(", {}", prior.in_words())),
            self.posterior.map_or_else(String::new, |draws| format!(", {draws} posterior draws"))
        )
    }
}

/// Chains of each structure in a posterior.
pub const CHAINS: usize = 4;

/// Number of draws: a multiple of [`CHAINS`], at least [`Draws::FEWEST`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Draws(NonZeroUsize);

impl Draws {
    /// Fewest draws from which a 95 % interval can be read.
    pub const FEWEST: usize = 400;

    /// `count` draws; `None` where that is no multiple of [`CHAINS`] or below [`Draws::FEWEST`].
    #[must_use]
    pub fn new(count: usize) -> Option<Self> {
        let count = NonZeroUsize::new(count)?;
        (count.get() >= Self::FEWEST && count.get().is_multiple_of(CHAINS)).then_some(Self(count))
    }

    /// The number.
    #[must_use]
    pub fn count(self) -> usize {
        self.0.get()
    }
}

impl fmt::Display for Draws {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        self.0.fmt(f)
    }
}
