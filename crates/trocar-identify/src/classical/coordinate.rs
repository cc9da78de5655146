//! Free parameters of the fits, and what is reported of them.

use trocar_model::{ParameterId, Quantity as Q};

/// Scales of the data, determined before any classical model is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scales {
    /// F_0, N.
    pub(crate) offset: f64,
    /// F_c, N.
    pub(crate) force: f64,
    /// β, N s/m.
    pub(crate) viscous: f64,
    /// Half of the travel between sliding in one direction and sliding in the other, m.
    pub(crate) half_width: f64,
    /// Longest stroke, m.
    pub(crate) stroke: f64,
    /// Slowest and fastest steady sliding, m/s.
    pub(crate) speeds: [f64; 2],
}

impl Scales {
    /// Without data: for what does not depend on them.
    pub(super) const NONE: Self = Self {
        offset: 0.0,
        force: 1.0,
        viscous: 1.0,
        half_width: 1.0,
        stroke: 1.0,
        speeds: [1.0; 2],
    };

    pub(super) fn coulomb(&self) -> Coordinate {
        Coordinate::log(Q::CoulombForce, [1e-2 * self.force, 1e2 * self.force])
    }

    pub(super) fn rise(&self) -> Coordinate {
        Coordinate::linear(Number::Rise, [0.0, 20.0 * self.force], 1e-4 * self.force)
    }

    pub(super) fn stribeck_velocity(&self) -> Coordinate {
        let [slowest, fastest] = self.speeds;
        Coordinate::log(Q::StribeckVelocity, [0.1 * slowest, 3.0 * fastest])
    }

    pub(super) fn damping(&self, id: impl Into<ParameterId>) -> Coordinate {
        let [_, fastest] = self.speeds;
        let most = 1e3 * self.force / fastest;
        Coordinate::linear(id.into(), [0.0, most], 1e-3 * self.force / fastest)
    }

    pub(super) fn stiffness(&self, id: impl Into<ParameterId>) -> Coordinate {
        let range = [1e-4 * self.force / self.stroke, 1e4 * self.force / self.half_width];
        Coordinate::log(id.into(), range)
    }

    /// Stiffness and limit of element `i`, from 0.
    pub(super) fn element(&self, i: usize) -> [Coordinate; 2] {
        let limit = Number::LimitDeflection(Q::LimitForce.id().of_element(i));
        [
            self.stiffness(Q::Stiffness.id().of_element(i)),
            Coordinate::log(limit, [1e-3 * self.half_width, 0.5 * self.stroke]),
        ]
    }

    /// Three of springs that would reach the force within the deformation, N/m.
    pub(super) fn stiffnesses(&self) -> [f64; 3] {
        [0.5, 2.0, 8.0].map(|factor| factor * self.force / self.half_width)
    }

    /// In the middle of the logarithms, m/s.
    pub(super) fn middle_speed(&self) -> f64 {
        let [slowest, fastest] = self.speeds;
        (slowest * fastest).sqrt()
    }

    pub(super) fn offset(&self) -> Coordinate {
        Coordinate::linear(Q::Offset, [f64::NEG_INFINITY, f64::INFINITY], 1e-4 * self.force)
    }
}

/// Elements among the free parameters: stiffness, limit deflection and what else each has.
#[derive(Clone, Copy)]
pub(super) struct Bank {
    /// Place of the first, the sensor offset counted.
    pub(super) first: usize,
    /// Parameters of each.
    pub(super) stride: usize,
}

impl Bank {
    /// Number of the derivative, among those that [`super::elements::Elements`] follow, of the free
    /// parameter `j`: that by the viscous damping is the first.
    pub(super) fn followed(self, j: usize) -> Option<usize> {
        if j == 1 { Some(0) } else { j.checked_sub(self.first).map(|k| k + 1) }
    }

    /// Σ k_i·Δ_i, N.
    pub(super) fn force(self, numbers: &[f64]) -> f64 {
        numbers[self.first..].chunks_exact(self.stride).map(|own| own[0] * own[1]).sum()
    }
}

/// What a free parameter is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Number {
    /// A parameter that is reported as it is.
    Reported(ParameterId),
    /// F_s − F_c, N.
    Rise,
    /// F_s/F_c − 1, where F_c is that of the bank.
    RelativeRise,
    /// A parameter in units of the force of the bank.
    Relative(ParameterId),
    /// Deflection at which the element of this id slips, m; the free parameter before it is the
    /// stiffness.
    LimitDeflection(ParameterId),
}

impl<T: Into<ParameterId>> From<T> for Number {
    fn from(id: T) -> Self {
        Self::Reported(id.into())
    }
}

/// One free parameter.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Coordinate {
    pub(super) number: Number,
    /// Whether the fit uses the logarithm.
    pub(super) log: bool,
    /// Range of the parameter itself.
    pub(super) range: [f64; 2],
    /// Step of the difference quotient, in the parameter or its logarithm.
    pub(super) step: f64,
}

impl Coordinate {
    pub(super) fn log(number: impl Into<Number>, range: [f64; 2]) -> Self {
        Self { number: number.into(), log: true, range, step: 1e-4 }
    }

    pub(super) fn linear(number: impl Into<Number>, range: [f64; 2], step: f64) -> Self {
        Self { number: number.into(), log: false, range, step }
    }
}

/// A quantity as a function of the free parameters.
type Formula = Box<dyn Fn(&[f64]) -> f64>;

/// A reported quantity as a function of the free parameters, the offset first.
pub(super) struct Reported {
    pub(super) id: ParameterId,
    /// Whether its interval is taken on the logarithm.
    pub(super) log: bool,
    pub(super) of: Formula,
    /// Free parameters that it represents. It is not determined if one of them is held at a bound.
    pub(super) from: Vec<usize>,
}

impl Reported {
    /// Least meaningful value: the value at the lower bound of the parameter that it represents.
    pub(super) fn least(&self, numbers: &[f64]) -> f64 {
        let [only] = self.from[..] else { return f64::NEG_INFINITY };
        if self.log || only == 0 {
            return f64::NEG_INFINITY;
        }
        let mut lowest = numbers.to_vec();
        lowest[only] = 0.0;
        (self.of)(&lowest)
    }
}

/// The reported parameters of a model: its free parameters, some replaced by the customary ones.
pub(super) fn reported(bank: Option<Bank>, coordinates: &[Coordinate]) -> Vec<Reported> {
    let sum = bank.map(|bank| Reported {
        id: Q::CoulombForce.id(),
        log: true,
        of: Box::new(move |p| bank.force(p)),
        from: Vec::new(),
    });
    let of_bank = move |p: &[f64]| bank.map_or(f64::NAN, |bank| bank.force(p));
    let usual = coordinates.iter().enumerate().map(|(j, c)| match c.number {
        Number::LimitDeflection(id) => {
            Reported { id, log: true, of: Box::new(move |p| p[j - 1] * p[j]), from: vec![j - 1, j] }
        }
        Number::Rise => static_force(j, move |p| p[j - 1] + p[j]),
        Number::RelativeRise => static_force(j, move |p| of_bank(p) * (1.0 + p[j])),
        Number::Relative(id) => {
            Reported { id, log: c.log, of: Box::new(move |p| of_bank(p) * p[j]), from: vec![j] }
        }
        Number::Reported(id) => {
            Reported { id, log: c.log, of: Box::new(move |p| p[j]), from: vec![j] }
        }
    });
    sum.into_iter().chain(usual).collect()
}

/// `rise` is the place of what it has above the Coulomb force.
fn static_force(rise: usize, of: impl Fn(&[f64]) -> f64 + 'static) -> Reported {
    Reported { id: Q::StaticForce.id(), log: false, of: Box::new(of), from: vec![rise] }
}
