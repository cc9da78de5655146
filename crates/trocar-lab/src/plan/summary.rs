//! What is printed of a plan.

use serde::Serialize;
use trocar_model::Quantity;

use super::{Goal, Plan, Prediction, Share};

/// What `trocar plan` prints as JSON.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary<'a> {
    /// What the motion is for, in words.
    pub goal: String,
    /// Time of the motion, s.
    pub duration_s: f64,
    /// Time after which the precision of the goal is expected, s; none for a goal without one.
    pub needed_s: Option<f64>,
    /// When the instrument begins to turn, s; none on a rig that does not turn it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turning_from_s: Option<f64>,
    /// Its cycles by kind.
    pub motion: &'a [Share],
    /// What to expect after it.
    pub expected: &'a [Prediction],
    /// Time of the paper's protocol on this rig, s; none where the rig cannot make it.
    pub paper_duration_s: Option<f64>,
    /// What to expect after that.
    pub paper_expected: Option<&'a [Prediction]>,
}

impl Plan {
    /// The summary of this plan, which was made for `goal`.
    pub fn summary(&self, goal: &Goal) -> Summary<'_> {
        Summary {
            goal: goal.to_string(),
            duration_s: self.duration_s(),
            needed_s: self.needed_s,
            turning_from_s: self.turning_from_s,
            motion: &self.shares,
            expected: &self.expected,
            paper_duration_s: self.paper.as_ref().map(|paper| paper.0),
            paper_expected: self.paper.as_ref().map(|paper| paper.1.as_slice()),
        }
    }

    /// The parameters that the motion will not determine, without the coefficients of the branches.
    pub fn undetermined(&self) -> impl Iterator<Item = &Prediction> {
        self.expected.iter().filter(|p| !p.determined && !p.is_coefficient())
    }
}

impl Prediction {
    /// That of the same parameter.
    pub fn among<'a>(&self, others: &'a [Prediction]) -> Option<&'a Prediction> {
        others.iter().find(|own| own.id == self.id)
    }

    /// Whether it is a parameter of rotation.
    pub fn is_around(&self) -> bool {
        matches!(
            self.id.quantity,
            Quantity::CircumferentialStiffness | Quantity::CircumferentialRatio
        )
    }

    /// Whether it is a coefficient of a branch, of which there are many and none means anything by itself.
    pub fn is_coefficient(&self) -> bool {
        matches!(self.id.quantity, Quantity::Coefficient { .. })
    }
}
