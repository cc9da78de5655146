//! Random motions, and what a step of each model promises: how large the force can be, and how much
//! it can change. The bounds follow from the parameters and the speeds of the motion alone.
#![allow(dead_code)] // each test binary uses its own part

use trocar_model::{Classical, Element, Seal, SlidingFriction, SlipElement, SlipRate, Trocar};

/// An evenly distributed number from a counter (SplitMix64, STEELE 2014).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// With an evenly distributed logarithm.
    fn scale(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.unit())
    }
}

/// Positions (m) at a period (s): a random walk of the velocity, a hand with tremor, a chirp, or
/// strokes, half of them on the counts of an encoder.
pub(crate) struct Motion {
    random: Random,
    kind: u32,
    period: f64,
    amplitude: f64,
    frequency: f64,
    count: f64,
    time: f64,
    walk: [f64; 2],
}

impl Motion {
    pub(crate) fn new(seed: u64) -> Self {
        let mut random = Random(seed);
        let count = if random.unit() < 0.5 { random.scale(1e-6, 1e-4) } else { 0.0 };
        Self {
            kind: (random.unit() * 4.0) as u32,
            period: if random.unit() < 0.5 { 1e-3 } else { random.scale(1e-5, 2e-2) },
            amplitude: random.scale(1e-4, 5e-2),
            frequency: random.scale(0.05, 2.0),
            count,
            time: 0.0,
            walk: [0.0; 2],
            random,
        }
    }

    /// `count` steps: displacement (m) and duration (s).
    pub(crate) fn steps(&mut self, count: usize) -> Vec<(f64, f64)> {
        let mut position = self.position();
        let step = |_| {
            let last = std::mem::replace(&mut position, self.position());
            (position - last, self.period)
        };
        (0..count).map(step).collect()
    }

    fn position(&mut self) -> f64 {
        let (a, w) = (self.amplitude, 2.0 * std::f64::consts::PI * self.frequency);
        self.time += self.period;
        let t = self.time;
        let position = match self.kind {
            0 => {
                // A velocity of some mm/s that forgets itself in 0.2 s.
                let kick = self.random.between(-1.0, 1.0) * (a * w) * (self.period / 0.2).sqrt();
                self.walk[1] += kick - self.walk[1] * (self.period / 0.2).min(1.0);
                self.walk[0] += self.walk[1] * self.period;
                self.walk[0]
            }
            1 => a * ((w * t).sin() + 0.4 * (2.7 * w * t).sin()) + 1e-4 * (56.5 * t).sin(),
            2 => a * (w * t * (1.0 + t)).sin(),
            _ => {
                let phase = (self.frequency * t).fract();
                a * (4.0 * (phase - 0.5).abs() - 1.0).clamp(-0.8, 0.8)
            }
        };
        if self.count > 0.0 { (position / self.count).round() * self.count } else { position }
    }
}

/// The present step of a motion, and the greatest speed up to it, m/s.
#[derive(Clone, Copy, Default)]
pub(crate) struct Past {
    greatest_speed: f64,
    velocity: f64,
    velocity_change: f64,
    travel: f64,
    duration: f64,
}

impl Past {
    /// One step later.
    pub(crate) fn after(self, (displacement, duration): (f64, f64)) -> Self {
        let velocity = displacement / duration;
        Self {
            greatest_speed: self.greatest_speed.max(velocity.abs()),
            velocity,
            velocity_change: (velocity - self.velocity).abs(),
            travel: displacement.abs(),
            duration,
        }
    }
}

/// What a step promises of the force.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Bounds {
    /// Of |F|, N.
    pub(crate) force: f64,
    /// Of |ΔF|, N.
    pub(crate) change: f64,
}

impl Bounds {
    /// Whether a step from force `from` to force `to`, N, keeps them, with `rounding` as a fraction
    /// of the largest force.
    pub(crate) fn hold(&self, from: f64, to: f64, rounding: f64) -> bool {
        let room = rounding * self.force;
        to.abs() <= self.force + room && (to - from).abs() <= self.change + room
    }
}

/// The numbers of a model from which its bounds follow.
pub(crate) enum Limits<'a> {
    Ems(Vec<(&'a Element, (f64, f64))>),
    Classical(&'a Classical),
}

impl<'a> Limits<'a> {
    pub(crate) fn of(seal: &'a Seal) -> Self {
        match seal {
            Seal::Ems(stages) => {
                Self::Ems(stages.elements().iter().map(|e| (e, extremes(e))).collect())
            }
            Seal::Classical(model) => Self::Classical(model),
        }
    }

    /// Of each element, or of the classical model.
    pub(crate) fn each(&self, past: &Past) -> Vec<Bounds> {
        match self {
            Self::Ems(all) => all.iter().map(|(e, known)| of_element(e, *known, past)).collect(),
            Self::Classical(model) => vec![of_classical(model, past)],
        }
    }

    /// Of the whole trocar, moved from position `from` to `to`, m: F_0(x) + gain(x)·F.
    pub(crate) fn whole<K: AsRef<[f64]>>(
        &self,
        trocar: &Trocar<K>,
        (from, to): (f64, f64),
        past: &Past,
    ) -> Bounds {
        let sum = self.each(past).iter().fold(Bounds::default(), |sum, own| Bounds {
            force: sum.force + own.force,
            change: sum.change + own.change,
        });
        let along = |x: f64| {
            let apply = |force: f64| trocar.profile().map_or(force, |own| own.apply(x, force));
            (apply(0.0), apply(1.0) - apply(0.0))
        };
        let ((offset, gain), (next_offset, next_gain)) = (along(from), along(to));
        Bounds {
            force: next_offset.abs() + next_gain * sum.force,
            change: next_gain * sum.change
                + (next_offset - offset).abs()
                + (next_gain - gain).abs() * sum.force,
        }
    }
}

/// Largest |F_e| over the branches, N, and largest |dF/dz| with all springs, N/m.
fn extremes(element: &Element) -> (f64, f64) {
    let params = element.params();
    let shape = &params.deformation;
    let c = shape.half_width();
    let branches = [shape.insertion(), shape.withdrawal()];
    let grid = (0..=400).map(|k| c * (f64::from(k) / 200.0 - 1.0));
    let (mut greatest, mut steepest) = (0.0_f64, 0.0_f64);
    for z in grid.chain(branches.iter().map(|branch| branch.join())) {
        for branch in branches {
            greatest = greatest.max(branch.force(z).abs());
            let slopes = [branch.left(), branch.right()].map(|piece| piece.stiffness(z).abs());
            steepest = steepest.max(slopes[usize::from(z >= branch.join())]);
        }
    }
    // A partial reversal is steeper by the yield stiffness; 5 % for what the grid misses.
    let stiffness = 1.05 * (steepest + shape.yield_stiffness());
    (1.01 * greatest, stiffness + params.relaxation.fast_stiffness())
}

fn of_element(element: &Element, (greatest, stiffness): (f64, f64), past: &Past) -> Bounds {
    let (params, v) = (element.params(), past.greatest_speed);
    let both = [&params.insertion, &params.withdrawal];
    let most = |of: fn(&SlidingFriction) -> f64| of(both[0]).max(of(both[1]));
    let static_force = most(|s| s.static_force);
    let least_force = both[0].coulomb_force.min(both[1].coulomb_force);
    let viscous = most(|s| s.viscous_damping) * v;
    let damping = params.damping.force(2.0 * v);
    let ends = params.deformation.end_stiffness();
    let c = params.deformation.half_width();
    let reach = 2.0 * (c + (static_force - least_force + viscous + damping) / ends.0.min(ends.1));
    let relaxing = params.relaxation.fast_stiffness() * reach;
    let greatest = greatest.max(static_force + viscous + damping) + relaxing;
    let [s0, s1, s2] = params.damping.coefficients;
    let damping_slope = s0 + 4.0 * v * (s1 + 3.0 * v * s2);
    let fading = params.relaxation.arms.map(|arm| (past.duration / arm.time).min(1.0));
    // Below 0.9·F_c the contact creeps at up to 2.1·v_c.
    let creep = match params.creep_velocity {
        0.0 => 0.0,
        speed => 0.1 * least_force + 2.1 * speed * stiffness * past.duration,
    };
    Bounds {
        force: greatest,
        change: stiffness * past.travel
            + damping_slope * past.velocity_change
            + relaxing * fading[0].max(fading[1])
            + creep
            + (greatest - least_force),
    }
}

fn of_classical(model: &Classical, past: &Past) -> Bounds {
    let v = past.greatest_speed;
    // Largest force at rest, stiffness, and the damping force at the greatest speed.
    let (held, stiffness, damped) = match model {
        Classical::Static(m) => (m.params().static_force, 0.0, 0.0),
        Classical::Dahl(m) => {
            let p = m.params();
            (p.coulomb_force, p.stiffness * 2.0_f64.powf(p.exponent), 0.0)
        }
        Classical::BoucWen(m) => {
            let p = m.params();
            (p.coulomb_force, p.stiffness * (2.0 * p.unloading_shape), 0.0)
        }
        Classical::LuGre(m) => {
            let p = m.params();
            let over = 1.0 + p.sliding.static_force / p.sliding.coulomb_force;
            (p.sliding.static_force, over * p.stiffness, over * p.micro_damping * v)
        }
        Classical::Leuven(m) => {
            let (p, k) = (m.params(), m.elements().iter().map(|e| e.stiffness).sum::<f64>());
            let over = 1.0 + (p.sliding.static_force / p.sliding.coulomb_force).powf(p.exponent);
            (p.sliding.static_force, over * k, over * p.micro_damping * v)
        }
        Classical::MaxwellSlip(m) => {
            let sum = |of: fn(&SlipElement) -> f64| m.elements().iter().map(of).sum();
            (sum(|e| e.limit_force), sum(|e| e.stiffness), 0.0)
        }
        Classical::Gms(m) => {
            let s = m.sliding();
            let over = 1.0 + s.static_force / s.coulomb_force;
            let k: f64 = m.elements().iter().map(|e| e.stiffness).sum();
            let damped = m.elements().iter().map(|e| e.damping * v.max(over * e.attraction)).sum();
            (s.static_force, k, damped)
        }
    };
    // Without memory the force jumps at a reversal; a free slip rate of GMS lets an element move by
    // itself, up to ν·(F_s + F_c).
    let free = match model {
        Classical::Static(_) => 2.0 * held,
        Classical::Gms(m) if m.slip_rate() == SlipRate::Free => 2.0 * held,
        _ => 0.0,
    };
    let viscous = model.viscous_damping();
    Bounds {
        force: held + viscous * v + damped,
        change: stiffness * past.travel + viscous * past.velocity_change + 2.0 * damped + free,
    }
}
