//! Surroundings of the rod: wetting of the seal, loads beside its force, and tissue beyond it.

use super::config::{Loading, Lubrication, Tissue, TissueKind};

/// Depth that defines the tissue's stiffness, m.
const REFERENCE_DEPTH: f64 = 0.01;

/// Friction of the seal at one time, relative to the dry one.
///
/// A wet seal slips at a lower force, but its rubber is as stiff as before. So forces and
/// deflections of the dry seal are scaled alike,
///
/// ```text
/// F_wet(x) = λ·F_dry(x/λ) + (ν − 1)·F_β        λ level, ν viscosity, F_β = β·v_sl
/// ```
/// which leaves dF/dx unchanged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wetting {
    pub(super) level: f64,
    viscosity: f64,
}

impl Wetting {
    /// At `time`, s: 1 before the onset, the final level after the spread, linear in between.
    pub(super) fn at(lubrication: &Lubrication, time: f64) -> Self {
        let since = time - lubrication.onset_s;
        let part = match since {
            since if since <= 0.0 => 0.0,
            since if since >= lubrication.spread_s => 1.0,
            since => since / lubrication.spread_s,
        };
        let [level, viscosity] =
            [lubrication.level, lubrication.viscosity].map(|end| 1.0 + part * (end - 1.0));
        Self { level, viscosity }
    }

    /// The displacement of the dry seal that corresponds to `displacement`, m.
    pub(super) fn of_dry(self, displacement: f64) -> f64 {
        displacement / self.level
    }

    /// The force of the wet seal for `force` of the dry one, of which `viscous` is the viscous
    /// part, N.
    pub(super) fn of_wet(self, force: f64, viscous: f64) -> f64 {
        self.level * (force + (self.viscosity - 1.0) * viscous)
    }
}

/// Side force, N, tilt, rad, and pressure, Pa, at `time`, s; 0 before the first sample.
pub(super) fn loads_at(loads: &Loading, time: f64) -> [f64; 3] {
    let since = time.max(0.0) * core::f64::consts::TAU / loads.period_s;
    let of = |largest: f64, periods: f64| match largest == 0.0 {
        true => 0.0,
        false => 0.5 * largest * (1.0 - libm::cos(since / periods)),
    };
    [of(loads.side_force_n, 1.0), of(loads.tilt_rad, 1.4), of(loads.pressure_pa, 0.7)]
}

/// Force, N, of the tip on the tissue at `time` (s), `position` (m) and `velocity` (m/s); keys
/// HUNTCROSSLEY and FUNG in SOURCES.md.
///
/// ```text
/// Hunt and Crossley   F = k·p^n·(1 + a·v)         p = x − x_surface > 0
/// Kelvin and Voigt    F = k·p + b·v
/// ```
/// Apart from the constant load neither pulls: F is at least 0.
pub(super) fn tissue_force(tissue: &Tissue, time: f64, position: f64, velocity: f64) -> f64 {
    let load =
        if (tissue.load_from_s..tissue.load_until_s).contains(&time) { tissue.load_n } else { 0.0 };
    let depth = (position - tissue.surface_m) / REFERENCE_DEPTH;
    if depth <= 0.0 {
        return load;
    }
    let exponent = if tissue.kind == TissueKind::HuntCrossley { tissue.exponent } else { 1.0 };
    let elastic = tissue.force_at_10_mm_n * libm::pow(depth, exponent);
    load + contact_force(
        tissue.kind,
        elastic,
        [tissue.damping_n_s_m, tissue.dissipation_s_m],
        velocity,
    )
}

/// Force, N, of tissue that pushes with `elastic` (N) at rest, at `velocity` (m/s); with b of Kelvin-Voigt
/// and a of Hunt-Crossley.
pub fn contact_force(
    kind: TissueKind,
    elastic: f64,
    [damping, dissipation]: [f64; 2],
    velocity: f64,
) -> f64 {
    let force = match kind {
        TissueKind::None => 0.0,
        TissueKind::HuntCrossley => elastic * (1.0 + dissipation * velocity),
        TissueKind::KelvinVoigt => elastic + damping * velocity,
    };
    force.max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::BenchConfig;

    fn tissue(kind: TissueKind) -> Tissue {
        Tissue { kind, surface_m: 0.05, ..BenchConfig::default().tissue }
    }

    /// A closed motion into the tissue dissipates work, and neither law pulls.
    #[test]
    fn tissue_takes_energy_and_never_pulls() {
        for kind in [TissueKind::HuntCrossley, TissueKind::KelvinVoigt] {
            let tissue = tissue(kind);
            let (mut work, steps) = (0.0, 10_000);
            for k in 0..steps {
                let phase = core::f64::consts::TAU * f64::from(k) / f64::from(steps);
                let (position, velocity) =
                    (0.055 - 0.01 * libm::cos(phase), 0.06 * libm::sin(phase));
                let force = tissue_force(&tissue, 1.0, position, velocity);
                assert!(force >= 0.0);
                work += force * velocity;
            }
            assert!(work > 0.0, "{kind:?}");
        }
        assert_eq!(tissue_force(&tissue(TissueKind::KelvinVoigt), 1.0, 0.051, -1.0), 0.0);
        let at_reference = tissue_force(&tissue(TissueKind::HuntCrossley), 1.0, 0.06, 0.0);
        assert!((at_reference - tissue(TissueKind::HuntCrossley).force_at_10_mm_n).abs() < 1e-12);
    }

    #[test]
    fn wetting_sets_in_over_its_spread() {
        let wet = Lubrication { level: 0.6, viscosity: 1.0, onset_s: 10.0, spread_s: 4.0 };
        let levels = [0.0, 10.0, 12.0, 14.0, 99.0, f64::NEG_INFINITY]
            .map(|time| Wetting::at(&wet, time).level);
        for (level, expected) in levels.into_iter().zip([1.0, 1.0, 0.8, 0.6, 0.6, 1.0]) {
            assert!((level - expected).abs() < 1e-12, "{levels:?}");
        }
    }
}
