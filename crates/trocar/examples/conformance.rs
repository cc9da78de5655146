//! Writes the cases that all interfaces must agree on: model files of every kind, and one motion.
//!
//! ```text
//! cargo run --release -p trocar --example conformance FOLDER
//! ```
//! `conformance/` in the repository holds what it wrote: models that are made up, and a motion with
//! slides, partial reversals, holds, uneven times, steps longer than the seal, and repeated rows; and in
//! `turning/` models and a motion that turn.

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use rand::SeedableRng;
use rand::distr::{Distribution, Uniform};
use rand_chacha::ChaCha8Rng;
use trocar::model_file::{ModelFile, Origin, OriginKind};
use trocar_model::{
    BoucWen, BoucWenParams, Classical, Dahl, DahlParams, Element, ElementParams, Gms, GmsElement,
    Leuven, LeuvenParams, LuGre, LuGreParams, MaxwellSlip, PositionProfile, Relaxation,
    RelaxationArm, Rotation, Seal, SealDamping, SlidingFriction, SlipElement, SlipRate, Stages,
    StaticFriction, StribeckCurve, Trocar,
};

/// Rows of the motion.
const ROWS: usize = 4000;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("name a folder")?;
    let folder = Path::new(&folder);
    fs::create_dir_all(folder.join("models"))?;
    for (name, file) in models()? {
        fs::write(folder.join("models").join(format!("{name}.json")), file.to_json())?;
    }
    fs::write(folder.join("motion.csv"), motion(false)?)?;
    let turning = folder.join("turning");
    fs::create_dir_all(turning.join("models"))?;
    for (name, mut file) in models()? {
        let Some(ratio) = ratio_of(name) else { continue };
        let rotation = Rotation {
            shaft_radius: 5e-3,
            circumferential_stiffness: 425.0,
            circumferential_ratio: ratio,
        };
        file.trocar = file.trocar.with_rotation(Some(rotation))?;
        fs::write(turning.join("models").join(format!("{name}_turning.json")), file.to_json())?;
    }
    fs::write(turning.join("motion.csv"), motion(true)?)?;
    Ok(())
}

/// F_t/F_c of the models that turn.
fn ratio_of(name: &str) -> Option<f64> {
    match name {
        "ems" => Some(1.0),
        "ems_stages" => Some(0.8),
        "ems_slow" | "ems_dwell" => Some(0.6),
        "ems_profile" => Some(1.2),
        _ => None,
    }
}

fn models() -> Result<Vec<(&'static str, ModelFile)>, Box<dyn Error>> {
    let plausible = ElementParams::plausible_10_5_mm()?;
    let sliding = SlidingFriction {
        coulomb_force: 2.0,
        static_force: 2.6,
        stribeck_velocity: 0.012,
        stribeck_exponent: 1.3,
        viscous_damping: 6.0,
    };
    let both = Stages::new(&[Element::new(plausible)?, stribeck(plausible, [4.0, 30.0, 200.0])?])
        .ok_or("two elements")?;
    let mut made: Vec<(&str, Seal)> = vec![
        ("ems", (Element::new(plausible)?).into()),
        ("ems_stribeck", (stribeck(plausible, [12.0, 0.0, 0.0])?).into()),
        ("ems_weakening", (velocity_weakening(plausible)?).into()),
        ("ems_slow", (slow(plausible)?).into()),
        ("ems_dwell", (resting(plausible)?).into()),
        ("ems_stages", both.into()),
    ];
    let bank: Vec<SlipElement> = (1..=5)
        .map(|k| SlipElement { stiffness: 400.0 / f64::from(k), limit_force: 0.2 * f64::from(k) })
        .collect();
    let lugre = |curve, damping_velocity| LuGreParams {
        stiffness: 800.0,
        micro_damping: 9.0,
        damping_velocity,
        sliding,
        curve,
    };
    let classical = [
        ("static", Classical::Static(StaticFriction::new(sliding)?)),
        (
            "dahl",
            Classical::Dahl(Dahl::new(DahlParams {
                stiffness: 700.0,
                coulomb_force: 2.0,
                exponent: 1.4,
                viscous_damping: 5.0,
            })?),
        ),
        (
            "bouc_wen",
            Classical::BoucWen(BoucWen::new(BoucWenParams {
                stiffness: 700.0,
                coulomb_force: 2.0,
                exponent: 1.7,
                unloading_shape: 0.8,
                viscous_damping: 5.0,
            })?),
        ),
        ("lugre", Classical::LuGre(LuGre::new(lugre(StribeckCurve::Exponential, f64::INFINITY))?)),
        ("lugre_rational", Classical::LuGre(LuGre::new(lugre(StribeckCurve::Rational, 0.02))?)),
        (
            "leuven",
            Classical::Leuven(Leuven::new(
                &bank,
                LeuvenParams { sliding, exponent: 1.2, micro_damping: 4.0 },
            )?),
        ),
        ("maxwell_slip", Classical::MaxwellSlip(MaxwellSlip::new(&bank, 5.0)?)),
        ("gms", Classical::Gms(gms(sliding, SlipRate::Limited)?)),
        ("gms_free", Classical::Gms(gms(sliding, SlipRate::Free)?)),
    ];
    made.extend(classical.map(|(name, model)| (name, model.into())));
    let mut files: Vec<_> =
        made.into_iter().map(|(name, model)| (name, ModelFile::new(model, origin()))).collect();
    let seal = stribeck(plausible, [3.0, 0.0, 0.0])?;
    let mut along = ModelFile::new(seal, origin());
    let (offset, gain) =
        (vec![0.1, -0.05, 0.0, 0.02, -0.1, 0.03], vec![0.8, 1.1, 1.2, 0.95, 0.95, 1.0]);
    along.trocar =
        Trocar::new(seal, Some(PositionProfile::new(0.05, 0.15, offset, mean_one(gain))?));
    files.push(("ems_profile", along));
    Ok(files)
}

fn mean_one(gain: Vec<f64>) -> Vec<f64> {
    let mean = gain.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).sum::<f64>()
        / (gain.len() - 1) as f64;
    gain.iter().map(|value| value / mean).collect()
}

fn origin() -> Origin {
    let mut origin = Origin::new(OriginKind::HandMade);
    origin.note = Some("made up, for comparing programs; no trocar was measured".to_owned());
    origin
}

/// The element with a static force above the sliding force.
fn stribeck(params: ElementParams, damping: [f64; 3]) -> Result<Element, Box<dyn Error>> {
    let mut values: Vec<f64> =
        Seal::from(Element::new(params)?).tunables().map(|tunable| tunable.value).collect();
    for (place, value) in [(2, 1.25), (3, 0.015), (6, 1.1), (7, 0.02)] {
        values[place] = value;
    }
    let Seal::Ems(stages) = Seal::from(Element::new(params)?).tuned(&values)? else {
        unreachable!("stays EMS")
    };
    let params = ElementParams {
        damping: SealDamping { coefficients: damping },
        ..*stages.first().params()
    };
    Ok(Element::new(params)?)
}

/// One whose force falls so fast with speed that it sticks and slips.
fn velocity_weakening(params: ElementParams) -> Result<Element, Box<dyn Error>> {
    let mut own = *stribeck(params, [0.0; 3])?.params();
    for side in [&mut own.insertion, &mut own.withdrawal] {
        (side.stribeck_velocity, side.stribeck_exponent) = (0.01, 0.8);
    }
    Ok(Element::new(own)?)
}

fn slow(params: ElementParams) -> Result<Element, Box<dyn Error>> {
    let own = *stribeck(params, [2.0, 0.0, 0.0])?.params();
    let arms = [
        RelaxationArm { stiffness: 60.0, time: 0.4 },
        RelaxationArm { stiffness: 30.0, time: 5.0 },
    ];
    let relaxation = Relaxation { arms };
    Ok(Element::new(ElementParams { creep_velocity: 2e-4, friction_lag: 0.02, relaxation, ..own })?)
}

fn resting(params: ElementParams) -> Result<Element, Box<dyn Error>> {
    let own = *stribeck(params, [2.0, 0.0, 0.0])?.params();
    Ok(Element::new(ElementParams { dwell_force: 0.3, ..own })?)
}

fn gms(sliding: SlidingFriction, slip_rate: SlipRate) -> Result<Gms, Box<dyn Error>> {
    let element = |k: u32| GmsElement {
        stiffness: 500.0 / f64::from(k),
        share: 0.25,
        attraction: 0.05 * f64::from(k),
        damping: 1.0,
    };
    Ok(Gms::new(&[element(1), element(2), element(3), element(4)], sliding, slip_rate)?)
}

/// Time and position, seeded: piecewise constant velocity, every fifth row at an uneven time; where it
/// `turns` also the angle, at up to three turns a second.
fn motion(turns: bool) -> Result<String, Box<dyn Error>> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let unit = Uniform::new(0.0, 1.0)?;
    let mut text =
        if turns { "time_s,position_m,angle_rad\n" } else { "time_s,position_m\n" }.to_owned();
    let (mut angle, mut turn) = (0.0_f64, 0.0_f64);
    let (mut time, mut position, mut velocity, mut left) = (0.0_f64, 0.1_f64, 0.0_f64, 0_u32);
    for row in 0..ROWS {
        write!(text, "{time:.6},{position:.9}")?;
        writeln!(text, "{}", if turns { format!(",{angle:.6}") } else { String::new() })?;
        if left == 0 {
            left = 5 + (150.0 * unit.sample(&mut random)) as u32;
            velocity = [0.0, 1.0, -1.0][(3.0 * unit.sample(&mut random)) as usize % 3]
                * 10f64.powf(-3.5 + 2.7 * unit.sample(&mut random));
            let towards = if position > 0.1 { -1.0 } else { 1.0 };
            velocity =
                if (position - 0.1).abs() > 0.04 { towards * velocity.abs() } else { velocity };
            if turns {
                let most = 6.0 * std::f64::consts::PI;
                turn = (most * (2.4 * unit.sample(&mut random) - 1.4)).clamp(-most, most).max(0.0)
                    * if angle > 6.0 { -1.0 } else { 1.0 };
            }
        }
        left -= 1;
        let duration = match row % 100 {
            37 => 0.0,
            73 => 0.25,
            k if k % 5 == 0 => 1e-3 * (0.2 + 3.0 * unit.sample(&mut random)),
            _ => 1e-3,
        };
        time = 1e-6 * ((time + duration) * 1e6).round();
        position = 1e-9 * ((position + velocity * duration) * 1e9).round();
        angle = 1e-6 * ((angle + turn * duration) * 1e6).round();
    }
    Ok(text)
}
