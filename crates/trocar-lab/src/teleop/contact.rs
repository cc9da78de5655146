//! What a contact displays of the tissue: with a seal that is undeformed when the tip touches, and with one that slides.
//!
//! A seal that deforms from the surface on adds its own stiffness to that of the tissue; one that slides adds its friction,
//! which hardly depends on the depth. The same loop displays both.

use trocar_model::Trocar;

use super::config::{Config, ConfigError, Press};
use super::merit::{Merit, displayed};
use super::simulation::Loop;

/// Least and greatest approach over which a seal is tried to slide, m.
const APPROACHES_M: [f64; 2] = [0.02, 0.16];
/// Difference of the seal's force after that approach and after twice that, relative to it, up to which it slides.
const SLIDES: f64 = 0.02;
/// Steps of that approach.
const STEPS: u32 = 1000;

impl Merit {
    /// The same with the figures of two pushes to the greatest depth of the motion of `config`, at its frequency, without breathing
    /// and noise, with `model` in the compensator and `plant` as the trocar.
    ///
    /// # Errors
    /// A value of `config` out of its range, or a model that cannot be made with it.
    pub(crate) fn with_contacts<K: AsRef<[f64]> + Clone>(
        self,
        config: &Config,
        [model, plant]: [&Trocar<K>; 2],
    ) -> Result<Self, ConfigError> {
        let Press { middle_m, amplitude_m, frequency_hz, .. } = config.motion;
        let depth = middle_m + amplitude_m.abs() - config.tissue.surface_m;
        if depth <= 0.0 || frequency_hz <= 0.0 {
            return Ok(self);
        }
        let push = |approach: f64| {
            let pushing = pushing(config, approach, depth);
            let mut pushed =
                Loop::new(&pushing, plant.clone(), model.clone(), pushing.motion.start_m())?;
            let course = pushed.run(pushing.samples(), |time| pushing.motion.at(time));
            Ok::<_, ConfigError>(course.map_or([None; 2], |samples| displayed(&pushing, &samples)))
        };
        let [displayed_from_rest_n_m, true_from_rest_n_m] = push(0.0)?;
        let [displayed_sliding_n_m, true_sliding_n_m] =
            approach(config, plant, depth).map_or(Ok([None; 2]), push)?;
        Ok(Self {
            displayed_from_rest_n_m,
            true_from_rest_n_m,
            displayed_sliding_n_m,
            true_sliding_n_m,
            ..self
        })
    }
}

/// The loop of one push that begins `approach` before the surface and intends to go `depth` beyond it, m.
fn pushing(config: &Config, approach: f64, depth: f64) -> Config {
    let mut pushing = config.quiet();
    let (frequency_hz, delay) = (config.motion.frequency_hz, 2.0 * config.channel.delay_s);
    pushing.motion = Press {
        middle_m: config.tissue.surface_m + 0.5 * (depth - approach),
        amplitude_m: 0.5 * (depth + approach),
        frequency_hz,
        duration_s: (0.5 / frequency_hz + delay).min(config.motion.duration_s),
        turning_rad_s: config.motion.turning_rad_s,
    };
    pushing
}

/// The least approach, m, after which the seal has forgotten where it began: it slides at the surface.
fn approach<K: AsRef<[f64]>>(config: &Config, trocar: &Trocar<K>, depth: f64) -> Option<f64> {
    let surface = config.tissue.surface_m;
    let [mut approach, greatest] = APPROACHES_M;
    while approach <= greatest {
        let speed = pushing(config, approach, depth).motion.peak_m_s();
        let [once, twice] = [approach, 2.0 * approach].map(|approach| {
            let (mut state, way) = (trocar.rest(surface - approach), approach / f64::from(STEPS));
            (1..=STEPS).fold(0.0, |_, k| {
                let angle = config.motion.angle(f64::from(k) * way / speed);
                trocar.turn(&mut state, way, angle, way / speed)
            })
        });
        if (once - twice).abs() <= SLIDES * twice.abs() {
            return Some(approach);
        }
        approach *= 2.0;
    }
    None
}
