//! Mixed-effects model: differences between types of trocar, between specimens of one type, and
//! between recordings of one specimen.
//!
//! ```text
//! y_ij = μ_type(i) + b_i + e_ij,   b_i ~ N(0, τ²),   e_ij ~ N(0, σ² + s_ij²)        i specimen, j recording
//! ```
//! s_ij is the standard error that the identification gives for y_ij; it is treated as known. τ and
//! σ are estimated by restricted maximum likelihood (REML), the means by generalised least squares
//! (LAIRD-WARE). Intervals of the means use Student's t with the number of specimens of the type
//! less one as degrees of freedom. ICC = τ²/(τ² + σ²), without the measurement error.

use trocar_identify::t_quantile;

/// Fewest specimens of a type for a mean with an interval.
pub(crate) const FEWEST_SPECIMENS: usize = 3;

/// One value: the indices of its type and specimen, and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Type, from 0.
    pub kind: usize,
    /// Specimen, from 0; belongs to one type.
    pub specimen: usize,
    /// Value.
    pub value: f64,
    /// Its standard error, ≥ 0.
    pub error: f64,
}

/// Mean of a type.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TypeMean {
    /// Type.
    pub kind: usize,
    /// Mean over specimens.
    pub mean: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// 95 % interval; `None` with fewer than [`FEWEST_SPECIMENS`] specimens.
    pub ci95: Option<[f64; 2]>,
    /// Number of specimens.
    pub specimens: usize,
    /// Number of recordings.
    pub recordings: usize,
}

/// Result of the fit.
#[derive(Debug, Clone, PartialEq)]
pub struct MixedEffects {
    /// Means, in the order of the types.
    pub means: Vec<TypeMean>,
    /// τ: standard deviation between specimens of a type.
    pub between: f64,
    /// σ: standard deviation between recordings of a specimen, without the measurement error.
    pub within: f64,
    /// Twice the negative restricted log-likelihood, without its constant.
    pub deviance: f64,
}

impl MixedEffects {
    /// τ²/(τ² + σ²): fraction of the variance that is between specimens; `None` without any
    /// variance.
    pub fn intraclass_correlation(&self) -> Option<f64> {
        let (between, within) = (self.between.powi(2), self.within.powi(2));
        (between + within > 0.0).then(|| between / (between + within))
    }
}

/// Fits the model.
///
/// # Errors
/// A message, if specimens or repeats are too few to separate the components.
pub fn fit(observations: &[Observation]) -> Result<MixedEffects, String> {
    let blocks = blocks(observations)?;
    let kinds = observations.iter().map(|o| o.kind).max().map_or(0, |most| most + 1);
    let most = spread(observations);
    if most == 0.0 {
        return Err("all values are equal".to_owned());
    }
    let deviance =
        |between: f64, within: f64| Solved::new(&blocks, kinds, between, within).deviance;
    let best_within = |between: f64| least(|within| deviance(between, within), most);
    let between = least(|between| deviance(between, best_within(between)), most);
    let within = best_within(between);
    let solved = Solved::new(&blocks, kinds, between, within);
    let means = (0..kinds).filter_map(|kind| solved.mean(kind, &blocks)).collect();
    Ok(MixedEffects { means, between, within, deviance: solved.deviance })
}

/// The observations of a specimen.
struct Block {
    kind: usize,
    values: Vec<(f64, f64)>,
}

fn blocks(observations: &[Observation]) -> Result<Vec<Block>, String> {
    let count = observations.iter().map(|o| o.specimen).max().map_or(0, |most| most + 1);
    let mut blocks: Vec<Block> =
        (0..count).map(|_| Block { kind: 0, values: Vec::new() }).collect();
    for o in observations {
        blocks[o.specimen].kind = o.kind;
        blocks[o.specimen].values.push((o.value, o.error * o.error));
    }
    blocks.retain(|block| !block.values.is_empty());
    let mut kinds: Vec<usize> = blocks.iter().map(|block| block.kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    let free = blocks.len().saturating_sub(kinds.len());
    if free < FEWEST_SPECIMENS - 1 {
        return Err(format!("{} specimens of {} types are too few", blocks.len(), kinds.len()));
    }
    if observations.len() < blocks.len() + 2 {
        return Err(
            "almost no specimen was recorded twice: specimens cannot be distinguished from recordings"
                .to_owned(),
        );
    }
    Ok(blocks)
}

/// A standard deviation above any plausible value of either component.
fn spread(observations: &[Observation]) -> f64 {
    let mean = observations.iter().map(|o| o.value).sum::<f64>() / observations.len() as f64;
    3.0 * (observations.iter().map(|o| (o.value - mean).powi(2)).sum::<f64>()
        / observations.len() as f64)
        .sqrt()
}

/// Minimum of `of` between 0 and `most` by golden-section search, including the end points.
fn least(of: impl Fn(f64) -> f64, most: f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    const SECTIONS: usize = 44;
    // Difference of deviances below which the data cannot distinguish a component from zero.
    const AS_GOOD: f64 = 1e-6;
    let (mut low, mut high) = (0.0, most);
    let mut inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
    let mut found = inner.map(&of);
    for _ in 0..SECTIONS {
        if found[0] <= found[1] {
            high = inner[1];
            inner = [high - GOLDEN * (high - low), inner[0]];
            found = [of(inner[0]), found[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + GOLDEN * (high - low)];
            found = [found[1], of(inner[1])];
        }
    }
    let middle = 0.5 * (low + high);
    if of(0.0) <= of(middle) + AS_GOOD { 0.0 } else { middle }
}

/// Generalised least squares for given variance components.
struct Solved {
    /// Information and mean of each type.
    kinds: Vec<(f64, f64)>,
    deviance: f64,
}

impl Solved {
    fn new(blocks: &[Block], kinds: usize, between: f64, within: f64) -> Self {
        let (between, within) = (between * between, within * within);
        let mut sums = vec![(0.0, 0.0); kinds];
        let (mut determinant, mut squares) = (0.0, 0.0);
        for block in blocks {
            // V = D + τ²·11ᵀ, inverted by Sherman and Morrison.
            let [mut w, mut wy, mut wyy] = [0.0; 3];
            for (value, error) in &block.values {
                let variance = (within + error).max(f64::MIN_POSITIVE);
                w += 1.0 / variance;
                wy += value / variance;
                wyy += value * value / variance;
                determinant += variance.ln();
            }
            let shared = between / (1.0 + between * w);
            determinant += (between * w).ln_1p();
            squares += wyy - shared * wy * wy;
            sums[block.kind].0 += w - shared * w * w;
            sums[block.kind].1 += wy - shared * w * wy;
        }
        for (information, score) in &mut sums {
            if *information > 0.0 {
                squares -= *score * *score / *information;
                determinant += information.ln();
                *score /= *information;
            }
        }
        Self { kinds: sums, deviance: determinant + squares }
    }

    fn mean(&self, kind: usize, blocks: &[Block]) -> Option<TypeMean> {
        let (information, mean) = self.kinds[kind];
        let own = || blocks.iter().filter(|block| block.kind == kind);
        let specimens = own().count();
        let standard_error = 1.0 / information.sqrt();
        let half = t_quantile(specimens as f64 - 1.0) * standard_error;
        let ci95 = (specimens >= FEWEST_SPECIMENS).then_some([mean - half, mean + half]);
        let recordings = own().map(|block| block.values.len()).sum();
        (information > 0.0).then_some(TypeMean {
            kind,
            mean,
            standard_error,
            ci95,
            specimens,
            recordings,
        })
    }
}
