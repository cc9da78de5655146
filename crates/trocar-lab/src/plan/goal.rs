//! What a motion is planned for.

use core::fmt;
use core::str::FromStr;

use trocar_model::ParameterId;

use super::config::ConfigError;
use trocar_identify::reported;

/// What a motion is planned for.
#[derive(Debug, Clone, PartialEq)]
pub enum Goal {
    /// The volume of the confidence region of all parameters (D-optimality).
    All,
    /// The error of the force along a hand's motion.
    Compensation,
    /// The variance of one parameter (c-optimality), and the half width of its 95 % interval, relative,
    /// that is wanted.
    Parameter(ParameterId, Option<f64>),
}

impl Goal {
    /// The parameter and its wanted precision.
    pub(super) fn wanted(&self) -> Option<(ParameterId, f64)> {
        match self {
            Self::Parameter(id, Some(wanted)) => Some((*id, *wanted)),
            _ => None,
        }
    }

    /// Whether partial reversals and rests belong to it.
    pub(super) fn needs_free_motion(&self) -> bool {
        !matches!(self, Self::Parameter(..))
    }
}

impl FromStr for Goal {
    type Err = ConfigError;

    fn from_str(text: &str) -> Result<Self, ConfigError> {
        let unknown = || {
            ConfigError::Unfit(format!(
                "unknown goal {text:?}, expected all, compensation, or a parameter, with a precision or without \
                 (viscous_damping_n_s_m, half_width_m:5%)"
            ))
        };
        match text {
            "all" => return Ok(Self::All),
            "compensation" => return Ok(Self::Compensation),
            _ => {}
        }
        let (name, wanted) = match text.split_once(':') {
            Some((name, wanted)) => (name, Some(wanted)),
            None => (text, None),
        };
        // The unit may be left out.
        let id = reported([4, 4]).into_iter().find(|id| {
            let full = id.to_string();
            full == name
                || full
                    .strip_suffix(id.unit().ending)
                    .is_some_and(|short| short.trim_end_matches('_') == name)
        });
        let id = id.ok_or_else(unknown)?;
        let wanted = wanted.map(|wanted| {
            let percent = wanted.trim_end_matches('%').trim().parse::<f64>().ok();
            percent.filter(|p| *p > 0.0 && p.is_finite()).map(|p| 1e-2 * p).ok_or_else(unknown)
        });
        Ok(Self::Parameter(id, wanted.transpose()?))
    }
}

impl fmt::Display for Goal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all parameters"),
            Self::Compensation => f.write_str("the force along a hand's motion"),
            Self::Parameter(id, None) => id.fmt(f),
            Self::Parameter(id, Some(wanted)) => write!(f, "{id} to {} %", 1e2 * wanted),
        }
    }
}
