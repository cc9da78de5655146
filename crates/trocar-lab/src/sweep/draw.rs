//! Values of the parameters of one run.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use trocar_model::Seal;

use super::config::{Law, SweepConfig};

/// The values of one run, in the order of the names.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Drawn {
    /// Of the seal.
    pub(crate) seal: Vec<f64>,
    /// Of the rig or of the loop.
    pub(crate) surroundings: Vec<f64>,
    /// Seed of their noise.
    pub(crate) seed: u64,
    /// A seal of its own in place of the model: from published ranges, or a posterior draw.
    pub(crate) own: Option<Result<Seal, String>>,
    /// Row of that draw, from 0.
    pub(crate) posterior_row: Option<usize>,
}

impl Drawn {
    /// Run `row` of `config`. The last name of the grid changes first, and the runs at one point
    /// are consecutive. Stream `row` of the generator gives the seed of the noise, then every drawn
    /// number in the order of the names, the seal's first.
    pub(crate) fn new(config: &SweepConfig, row: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(config.seed);
        generator.set_stream(row);
        // Below 2^53: exactly representable as an integer in every table.
        let seed = generator.next_u64() >> 11;
        let mut point = row / config.runs;
        let choices = config.seal.iter().chain(config.surroundings());
        let laws: Vec<&Law> = choices.map(|(_, choice)| &choice.law).collect();
        let mut values: Vec<f64> = laws.iter().map(|law| draw(law, &mut generator)).collect();
        for (value, law) in values.iter_mut().zip(&laws).rev() {
            if let Some(grid) = law.grid() {
                let count = grid.len() as u64;
                *value = grid[(point % count) as usize];
                point /= count;
            }
        }
        let surroundings = values.split_off(config.seal.len());
        Self { seal: values, surroundings, seed, own: None, posterior_row: None }
    }
}

fn draw(law: &Law, generator: &mut ChaCha8Rng) -> f64 {
    match law {
        Law::Fixed(value) => *value,
        Law::Uniform([low, high]) => low + (high - low) * unit(generator),
        Law::Normal([mean, deviation]) => mean + deviation * normal(generator),
        Law::Lognormal([median, deviation]) => median * libm::exp(deviation * normal(generator)),
        Law::Triangular([least, likely, greatest]) => {
            let (part, width) = (unit(generator), greatest - least);
            // The inverse of the distribution function.
            let below = likely - least;
            if part * width < below {
                least + libm::sqrt(part * width * below)
            } else {
                greatest - libm::sqrt((1.0 - part) * width * (greatest - likely))
            }
        }
        Law::List(values) => {
            values[(unit(generator) * values.len() as f64) as usize % values.len()]
        }
        Law::Grid(_) => 0.0,
    }
}

/// Uniform in [0, 1), without rounding.
fn unit(generator: &mut ChaCha8Rng) -> f64 {
    (generator.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
}

/// Standard normal, by the method of Box and Muller.
fn normal(generator: &mut ChaCha8Rng) -> f64 {
    let (radius, angle) = (1.0 - unit(generator), std::f64::consts::TAU * unit(generator));
    libm::sqrt(-2.0 * libm::log(radius)) * libm::cos(angle)
}
