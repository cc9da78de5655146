//! A sweep as a TOML document. `data/sweep.toml` is an example that describes every key.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::SweepError;
use trocar_simulate::bench::Protocol;

/// The shipped example, which describes every key.
pub const EXAMPLE_TOML: &str = include_str!("../../data/sweep.toml");

/// Most rows of a table.
pub(crate) const MAX_ROWS: u64 = 1_000_000_000;

/// The parameters to vary, and the motion.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepConfig {
    /// Runs for each point of the grid, at least 1.
    #[serde(default = "one")]
    pub runs: u64,
    /// Seed of all draws.
    #[serde(default = "one")]
    pub seed: u64,
    /// File of the model to vary; none selects the plausible trocar.
    #[serde(default)]
    pub model: Option<PathBuf>,
    /// Key of published ranges from which each run draws a seal of its own, in place of a model.
    #[serde(default)]
    pub like: Option<String>,
    /// File of posterior draws of the model's parameters, from which each run takes its seal.
    #[serde(default)]
    pub posterior: Option<PathBuf>,
    /// The motion.
    pub motion: Motion,
    /// Parameters of the seal by name.
    #[serde(default)]
    pub seal: BTreeMap<String, Choice>,
    /// Keys of the bench's document.
    #[serde(default)]
    pub rig: BTreeMap<String, Choice>,
    /// Keys of the loop's document.
    #[serde(default)]
    pub teleop: BTreeMap<String, Choice>,
}

fn one() -> u64 {
    1
}

/// The motion of a sweep: an experiment of the bench, a file, or a teleoperation loop.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Experiment of the virtual bench.
    #[serde(default)]
    pub protocol: Option<String>,
    /// Configuration of the rig; none selects the default.
    #[serde(default)]
    pub rig: Option<PathBuf>,
    /// File with time and position.
    #[serde(default)]
    pub file: Option<PathBuf>,
    /// Teleoperation loop: name of one that is shipped ([`crate::teleop::config::PRESETS`], or `default`), or a file.
    #[serde(default)]
    pub teleop: Option<String>,
}

/// Source of the values of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// The distribution.
    pub law: Law,
    /// Whether the values are multiples of the model's own.
    pub relative: bool,
}

/// Distributions of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub enum Law {
    /// Constant.
    Fixed(f64),
    /// Uniform between two numbers.
    Uniform([f64; 2]),
    /// Mean and standard deviation.
    Normal([f64; 2]),
    /// Median, and standard deviation of the logarithm.
    Lognormal([f64; 2]),
    /// Minimum, mode, maximum.
    Triangular([f64; 3]),
    /// One of these, with equal probability.
    List(Vec<f64>),
    /// Every one of these.
    Grid(Vec<f64>),
}

/// A table in the document.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Form {
    uniform: Option<[f64; 2]>,
    normal: Option<[f64; 2]>,
    lognormal: Option<[f64; 2]>,
    triangular: Option<[f64; 3]>,
    list: Option<Vec<f64>>,
    grid: Option<Vec<f64>>,
    #[serde(default)]
    relative: bool,
}

impl Form {
    fn choice(self) -> Result<Choice, &'static str> {
        let laws = [
            self.uniform.map(Law::Uniform),
            self.normal.map(Law::Normal),
            self.lognormal.map(Law::Lognormal),
            self.triangular.map(Law::Triangular),
            self.list.map(Law::List),
            self.grid.map(Law::Grid),
        ];
        let mut given = laws.into_iter().flatten();
        match (given.next(), given.next()) {
            (Some(law), None) => Ok(Choice { law, relative: self.relative }),
            _ => Err("expected one of uniform, normal, lognormal, triangular, list, grid"),
        }
    }
}

impl<'de> Deserialize<'de> for Choice {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ChoiceVisitor)
    }
}

struct ChoiceVisitor;

impl<'de> Visitor<'de> for ChoiceVisitor {
    type Value = Choice;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number or a form such as { uniform = [1.0, 2.0] }")
    }

    fn visit_f64<E>(self, value: f64) -> Result<Choice, E> {
        Ok(Choice { law: Law::Fixed(value), relative: false })
    }

    fn visit_i64<E>(self, value: i64) -> Result<Choice, E> {
        Ok(Choice { law: Law::Fixed(value as f64), relative: false })
    }

    fn visit_u64<E>(self, value: u64) -> Result<Choice, E> {
        Ok(Choice { law: Law::Fixed(value as f64), relative: false })
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Choice, A::Error> {
        Form::deserialize(MapAccessDeserializer::new(map))?
            .choice()
            .map_err(serde::de::Error::custom)
    }
}

impl Law {
    /// Description of invalid numbers.
    fn fault(&self) -> Option<&'static str> {
        let (numbers, good, wanted): (&[f64], bool, _) = match self {
            Self::Fixed(_) => (&[], true, ""),
            Self::Uniform(range) => (range, range[0] <= range[1], "the lower number first"),
            Self::Normal(pair) => (pair, pair[1] >= 0.0, "a standard deviation of 0 or more"),
            Self::Lognormal(pair) => (
                pair,
                pair[0] > 0.0 && pair[1] >= 0.0,
                "a median above 0 and a standard deviation of 0 or more",
            ),
            Self::Triangular(three) => {
                let [least, likely, greatest] = *three;
                (
                    three,
                    least <= likely && likely <= greatest,
                    "least, most likely and greatest in this order",
                )
            }
            Self::List(values) | Self::Grid(values) => {
                (values, !values.is_empty(), "one number or more")
            }
        };
        match (numbers.iter().all(|number| number.is_finite()), good) {
            (false, _) => Some("finite numbers"),
            (_, false) => Some(wanted),
            _ => None,
        }
    }

    /// The values of a grid.
    pub(crate) fn grid(&self) -> Option<&[f64]> {
        match self {
            Self::Grid(values) => Some(values),
            _ => None,
        }
    }
}

impl SweepConfig {
    /// Reads a document.
    ///
    /// # Errors
    /// [`SweepError`] with the line: invalid TOML, an unknown key, an invalid distribution or
    /// number.
    pub fn from_toml(text: &str) -> Result<Self, SweepError> {
        let config: Self =
            toml::from_str(text).map_err(|error| SweepError::Syntax(error.to_string()))?;
        config.check(text)?;
        Ok(config)
    }

    /// Checks its numbers; `text` is the source document, or empty.
    pub(crate) fn check(&self, text: &str) -> Result<(), SweepError> {
        for (name, choice) in self.seal.iter().chain(self.surroundings()) {
            if let Some(wanted) = choice.law.fault() {
                return Err(SweepError::Form {
                    line: line_of(text, name),
                    key: name.clone(),
                    wanted,
                });
            }
        }
        if self.like.is_some() && (self.model.is_some() || !self.seal.is_empty()) {
            return Err(SweepError::LikeAlone { line: line_of(text, "like") });
        }
        if self.posterior.is_some() && (self.like.is_some() || !self.seal.is_empty()) {
            return Err(SweepError::PosteriorAlone { line: line_of(text, "posterior") });
        }
        if self.runs == 0 {
            return Err(SweepError::NoRuns { line: line_of(text, "runs") });
        }
        self.check_motion()?;
        match self.rows() {
            Some(_) => Ok(()),
            None => Err(SweepError::TooMany { limit: MAX_ROWS }),
        }
    }

    fn check_motion(&self) -> Result<(), SweepError> {
        let Motion { protocol, rig, file, teleop } = &self.motion;
        let refuse = |why| Err(SweepError::Motion { why });
        let given = [protocol.is_some(), file.is_some(), teleop.is_some()];
        match given.iter().filter(|is_given| **is_given).count() {
            0 => return refuse("none of protocol, file and teleop is given"),
            1 => {}
            _ => return refuse("protocol, file and teleop exclude each other"),
        }
        if protocol.is_none() && (rig.is_some() || !self.rig.is_empty()) {
            return refuse("a rig runs a protocol, neither a file nor a loop");
        }
        if teleop.is_none() && !self.teleop.is_empty() {
            return refuse("[teleop] changes a loop, and none is given");
        }
        let known = |name: &String| name.parse::<Protocol>().map(drop);
        protocol
            .as_ref()
            .map_or(Ok(()), known)
            .map_err(|unknown| SweepError::Protocol { unknown: unknown.to_string() })
    }

    /// Numbers of the rig or of the loop that vary.
    pub(crate) fn surroundings(&self) -> impl Iterator<Item = (&String, &Choice)> {
        self.rig.iter().chain(&self.teleop)
    }

    /// Number of points of the grid.
    pub(crate) fn points(&self) -> Option<u64> {
        let choices = self.seal.iter().chain(self.surroundings());
        let grids = choices.filter_map(|(_, choice)| choice.law.grid());
        grids.map(|values| values.len() as u64).try_fold(1_u64, u64::checked_mul)
    }

    /// Number of rows of the table; `None` above [`MAX_ROWS`].
    pub fn rows(&self) -> Option<u64> {
        self.points()?.checked_mul(self.runs).filter(|rows| *rows <= MAX_ROWS)
    }
}

/// Line of `key`, from 1; 0 if it is not found.
pub(crate) fn line_of(text: &str, key: &str) -> usize {
    let names = |line: &str| {
        let name = line.split('=').next().unwrap_or_default().trim().trim_matches(['"', '\'']);
        name == key && line.contains('=')
    };
    text.lines().position(names).map_or(0, |line| line + 1)
}
