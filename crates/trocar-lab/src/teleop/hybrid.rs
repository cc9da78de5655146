//! Linear theory of a loop: its hybrid matrix, the impedance felt of the tissue, and the margin of Llewellyn's criterion.
//!
//! Sampling, jitter, loss, resolutions, passivity control and the damping of Hunt-Crossley tissue are left out: the
//! controllers are taken as continuous, with the delay as e^(−sT). The seal
//! is a linear impedance: nothing, or its describing function ([`seal_impedance`]), the first harmonic of
//! its force at one amplitude and frequency. With friction a loop is not linear, and these figures hold
//! for that amplitude only.

use std::f64::consts::TAU;

use nalgebra::{Complex, ComplexField};
use trocar_model::Trocar;

use super::config::{Architecture, Config, ConfigError, Control, Place, TissueKind};
use trocar_recording::cancel;

/// Hybrid matrix, `[F_h; −v_s] = H·[v_m; F_e]`; ideal is `[[0, 1], [−1, 0]]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hybrid {
    /// N s/m
    pub h11: Complex<f64>,
    /// 1
    pub h12: Complex<f64>,
    /// 1
    pub h21: Complex<f64>,
    /// m/(N s)
    pub h22: Complex<f64>,
}

/// A loop at one frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// Hz
    pub frequency_hz: f64,
    /// With the trocar as its describing function.
    pub hybrid: Hybrid,
    /// Margin of Llewellyn's criterion ([`Hybrid::llewellyn`]).
    pub llewellyn: f64,
    /// Impedance of the tissue in contact, N s/m.
    pub tissue: Complex<f64>,
    /// Impedance that the operator feels of it, N s/m.
    pub transmitted: Complex<f64>,
}

/// Lowest and highest frequency over which a hybrid matrix is shown, Hz, and how many.
const SHOWN_HZ: [f64; 2] = [0.1, 100.0];
const SHOWN: u32 = 61;

/// The 61 frequencies over which a hybrid matrix is shown, Hz: 0.1 to 100, evenly in their logarithm.
pub fn frequencies() -> Vec<f64> {
    let [low, high] = SHOWN_HZ;
    let ratio = (high / low).ln() / f64::from(SHOWN - 1);
    (0..SHOWN).map(|k| low * (ratio * f64::from(k)).exp()).collect()
}

/// The hybrid matrix of `config` at each of `frequencies_hz`, with the describing functions of the model in the compensator (at
/// its friction scale) and of the trocar, `models`, for strokes of `amplitude_m` around the surface of the tissue. An
/// adaptive compensator counts as its model.
///
/// # Errors
/// A value of `config`, the amplitude or a frequency out of its range.
pub fn response<K: AsRef<[f64]> + Clone>(
    config: &Config,
    [model, plant]: [&Trocar<K>; 2],
    amplitude_m: f64,
    frequencies_hz: &[f64],
) -> Result<Vec<Response>, ConfigError> {
    config.check()?;
    positive("amplitude_m", amplitude_m)?;
    let Control { architecture, stiffness_n_m, damping_n_s_m, .. } = config.control;
    if architecture == Architecture::Wave && stiffness_n_m + damping_n_s_m == 0.0 {
        let (name, allowed) = ("control.stiffness_n_m", "above 0 if control.damping_n_s_m is 0");
        return Err(ConfigError::OutOfRange { name, allowed, found: 0.0 });
    }
    let model = config.compensation.model(model)?;
    frequencies_hz
        .iter()
        .map(|&frequency_hz| {
            cancel::check();
            positive("frequency_hz", frequency_hz)?;
            let impedances = [&model, plant]
                .map(|trocar| seal_impedance(trocar, config, amplitude_m, frequency_hz));
            let hybrid = Hybrid::with_compensator(config, impedances, frequency_hz);
            let tissue = tissue_impedance(config, frequency_hz);
            let (llewellyn, transmitted) = (hybrid.llewellyn(), hybrid.transmitted(tissue));
            Ok(Response { frequency_hz, hybrid, llewellyn, tissue, transmitted })
        })
        .collect()
}

fn positive(name: &'static str, found: f64) -> Result<(), ConfigError> {
    match (1e-9..=1e6).contains(&found) {
        true => Ok(()),
        false => Err(ConfigError::OutOfRange { name, allowed: "from 1e-9 to 1e6", found }),
    }
}

/// Steps of one period for the describing function.
const STEPS: u32 = 2000;
/// Periods before the one that counts.
const PERIODS: u32 = 2;

/// Describing function of the trocar as an impedance, N s/m, at `amplitude` (m) around the surface of the
/// tissue, while it turns as in `config`: the first harmonic of F_t over that of the velocity.
pub fn seal_impedance<K: AsRef<[f64]>>(
    trocar: &Trocar<K>,
    config: &Config,
    amplitude: f64,
    frequency_hz: f64,
) -> Complex<f64> {
    let position = config.tissue.surface_m;
    let omega = TAU * frequency_hz;
    let step = 1.0 / (frequency_hz * f64::from(STEPS));
    let mut state = trocar.rest(position);
    let mut sum = Complex::new(0.0, 0.0);
    for k in 1..=(PERIODS + 1) * STEPS {
        let phase = TAU * f64::from(k) / f64::from(STEPS);
        let angle = config.motion.angle(f64::from(k) * step);
        let force = trocar.turn_to(&mut state, position + amplitude * phase.sin(), angle, step);
        if k > PERIODS * STEPS {
            sum += Complex::new(phase.cos(), -phase.sin()) * force;
        }
    }
    // The velocity amplitude·ω·cos has the first harmonic amplitude·ω.
    sum * 2.0 / f64::from(STEPS) / (amplitude * omega)
}

impl Hybrid {
    /// The matrix of `config` at `frequency_hz`, with the impedance of the trocar, `seal` (N s/m), which is also that of the
    /// compensator's model.
    pub fn of(config: &Config, seal: Complex<f64>, frequency_hz: f64) -> Self {
        Self::with_compensator(config, [seal, seal], frequency_hz)
    }

    /// The same with the impedances of the compensator's model and of the trocar, N s/m.
    pub fn with_compensator(
        config: &Config,
        [model, seal]: [Complex<f64>; 2],
        frequency_hz: f64,
    ) -> Self {
        let s = Complex::new(0.0, TAU * frequency_hz);
        let one = Complex::new(1.0, 0.0);
        let delay = (-s * config.channel.delay_s).exp();
        let control = config.control;
        let follow = one * control.damping_n_s_m + one * control.stiffness_n_m / s;
        let leader = s * config.leader.mass_kg + config.leader.damping_n_s_m;
        let follower = s * config.follower.mass_kg + config.follower.damping_n_s_m;
        // What the estimate holds beside F_e, per velocity of the follower.
        let beside = match config.sensor.place {
            Place::Tip => Complex::new(0.0, 0.0),
            Place::Outside => {
                seal - model * config.compensation.fraction + s * config.sensor.moving_mass_kg
            }
        };
        match control.architecture {
            Architecture::PositionPosition => {
                let all = follower + seal + follow;
                let (h21, h22) = (-follow * delay / all, one / all);
                // F_h = Z_m·v_m + C·(v_m − D·v_s)
                let back = follow * delay;
                Self { h11: leader + follow + back * h21, h12: back * h22, h21, h22 }
            }
            Architecture::PositionForce => {
                let all = follower + seal + follow;
                let (h21, h22) = (-follow * delay / all, one / all);
                let gain = delay * control.force_gain;
                // F_h = Z_m·v_m + λ·D·(F_e + beside·v_s)
                Self {
                    h11: leader - gain * beside * h21,
                    h12: gain * (one - beside * h22),
                    h21,
                    h22,
                }
            }
            Architecture::FourChannel => {
                Self::of_four_channels(&control, [seal, beside], delay, [leader, follower, follow])
            }
            Architecture::Wave => Self::of_waves(config, seal, delay, [leader, follower, follow]),
        }
    }

    /// Four channels; e = 1 + C_5, f = 1 + C_6, with `beside` as what the estimate holds beside F_e per v_s:
    /// (Z_s + C)·(v_s − D·v_m) = e·(D·F_h − F_e) − (seal + C_5·beside)·v_s and
    /// (Z_m + C)·(v_m − D·v_s) = f·(F_h − D·F_e − D·beside·v_s)
    fn of_four_channels(
        control: &Control,
        [seal, beside]: [Complex<f64>; 2],
        delay: Complex<f64>,
        [leader, follower, follow]: [Complex<f64>; 3],
    ) -> Self {
        let one = Complex::new(1.0, 0.0);
        let (a, b) = (follower + follow, leader + follow);
        let [e, f] = [control.follower_force_feedback, control.leader_force_feedback]
            .map(|local| one * (1.0 + local));
        // −e·D·F_h + p·v_s = a·D·v_m − e·F_e and f·F_h + q·v_s = b·v_m + f·D·F_e
        let p = a + seal + beside * control.follower_force_feedback;
        let q = delay * (b - f * beside);
        let all = e * delay * q + f * p;
        let way = delay * delay - one;
        Self {
            h11: (b * p - a * delay * q) / all,
            h12: (f * delay * p + e * q) / all,
            h21: -(f * a + e * b) * delay / all,
            h22: -e * f * way / all,
        }
    }

    /// Waves: `u_s = D·u_m`, `w_m = D·w_s`, with `F_sc = C·(v_d − v_s)`.
    fn of_waves(
        config: &Config,
        seal: Complex<f64>,
        delay: Complex<f64>,
        [leader, follower, follow]: [Complex<f64>; 3],
    ) -> Self {
        let one = Complex::new(1.0, 0.0);
        let b = config.control.wave_impedance_n_s_m;
        // v_s = (F_sc − F_e)/load; v_d = v_s + F_sc/C.
        let load = follower + seal;
        // The follower's side seen from the waves: v_d = y·F_sc − F_e/load.
        let y = one / load + one / follow;
        // From u, w by v_d and F_sc:  b·v_d + F_sc = √(2b)·u_s,  b·v_d − F_sc = √(2b)·w_s, and at the leader alike
        // b·v_m + F_mc = √(2b)·u_m,  b·v_m − F_mc = √(2b)·w_m.
        let (plus, minus) = (y * b + one, y * b - one);
        let d2 = delay * delay;
        // b·v_m − F_mc = D·(minus·F_sc − b·F_e/load),  plus·F_sc = D·(b·v_m + F_mc) + b·F_e/load
        let turn = d2 * minus / plus;
        // F_mc·(1 + turn) = b·v_m·(1 − turn) + D·b·F_e/load·(1 − minus/plus)
        let f_v = (one - turn) * b / (one + turn);
        let f_e = delay * b / load * (one - minus / plus) / (one + turn);
        // F_sc from v_m and F_e.
        let s_v = delay * (one * b + f_v) / plus;
        let s_e = (delay * f_e + one * b / load) / plus;
        Self { h11: leader + f_v, h12: f_e, h21: -s_v / load, h22: (one - s_e) / load }
    }

    /// Impedance that the operator feels, N s/m, of the tissue's `environment`, N s/m:
    /// `Z_t = (h11 + (h11·h22 − h12·h21)·Z_e)/(1 + h22·Z_e)`.
    pub fn transmitted(&self, environment: Complex<f64>) -> Complex<f64> {
        let determinant = self.h11 * self.h22 - self.h12 * self.h21;
        (self.h11 + determinant * environment) / (environment * self.h22 + 1.0)
    }

    /// Margin of Llewellyn's criterion, N s/m·m/(N s) = 1; with any passive operator and tissue the loop is stable if it is
    /// not below 0 at any frequency and Re h11 and Re h22 are not either:
    /// `2·Re h11·Re h22 − Re(h12·h21) − |h12·h21|`.
    pub fn llewellyn(&self) -> f64 {
        let product = self.h12 * self.h21;
        2.0 * self.h11.re * self.h22.re - product.re - product.modulus()
    }
}

/// Impedance of the tissue in contact, N s/m.
pub fn tissue_impedance(config: &Config, frequency_hz: f64) -> Complex<f64> {
    let tissue = config.tissue;
    let (damping, stiffness) = match tissue.kind {
        TissueKind::None => (0.0, 0.0),
        TissueKind::HuntCrossley => (0.0, tissue.stiffness_n_m),
        TissueKind::KelvinVoigt => (tissue.damping_n_s_m, tissue.stiffness_n_m),
    };
    Complex::new(damping, -stiffness / (TAU * frequency_hz))
}
