//! Trajectories of an EMS element written by another author from the paper alone, single-valued
//! deformation curve.

use crate::shared::shared_vector;
use trocar_model::{
    Branch, DeformationForce, Element, ElementParams, Mode, Piece, Relaxation, SealDamping,
    SlidingFriction,
};

use paper_literal::{LiteralState, PaperLiteral};

#[path = "../../trocar/examples/literal_reading/paper_literal.rs"]
mod paper_literal;

/// Agreement demanded of the literal reading, N: the reference integrates to about 1e-10 N.
const LITERAL_TOLERANCE: f64 = 1e-8;

const PERIOD: f64 = 1e-3;

struct Row {
    position: f64,
    deflection: f64,
    sliding: bool,
    force: f64,
}

/// The rows of a shared trajectory, or `None` with the reason printed when the folder is not there.
fn rows(name: &str) -> Option<Vec<Row>> {
    let text = shared_vector(name)?;
    let row = |line: &str| {
        let numbers: Vec<f64> = line.split(',').map(|word| word.parse().unwrap()).collect();
        Row {
            position: numbers[1],
            deflection: numbers[2],
            sliding: numbers[3] != 0.0,
            force: numbers[4],
        }
    };
    Some(text.lines().skip(1).map(row).collect())
}

/// f = A·(z^5/5 - (65/12)·z^3 + 49·z), z in mm, A = 0.0131 N, on both branches.
fn params(sigma: f64, half_width: f64) -> ElementParams {
    let a = 0.0131;
    let monomial = [0.0, a * 49.0 * 1e3, 0.0, -a * 65.0 / 12.0 * 1e9, 0.0, a / 5.0 * 1e15];
    let left = Piece::from_monomial(-half_width, 0.0, &monomial).unwrap();
    let right = Piece::from_monomial(0.0, half_width, &monomial).unwrap();
    let branch = Branch::new(left, right).unwrap();
    let sliding = SlidingFriction::coulomb(1.5, 2.0);
    ElementParams {
        deformation: DeformationForce::new(branch, branch, None).unwrap(),
        damping: SealDamping::constant(sigma),
        insertion: sliding,
        withdrawal: sliding,
        creep_velocity: 0.0,
        friction_lag: 0.0,
        dwell_force: 0.0,
        relaxation: Relaxation::NONE,
    }
}

fn literal_reading_matches(name: &str, sigma: f64) {
    let Some(rows) = rows(name) else { return };
    let element = PaperLiteral::new(params(sigma, 8e-3));
    let mut state = LiteralState::new(0.0);
    let (mut worst, mut modes_apart) = (0.0_f64, 0);
    for pair in rows.windows(2) {
        let velocity = (pair[1].position - pair[0].position) / PERIOD;
        // A row holds the state at the start of its interval and the force with the velocity of the
        // interval.
        let force = element.force(&state, velocity);
        element.step_velocity(&mut state, velocity, PERIOD);
        worst = worst.max((force - pair[0].force).abs());
        modes_apart += usize::from((state.mode() == Mode::Sliding) != pair[1].sliding);
        assert!(
            (state.deflection() - pair[1].deflection).abs() < 1e-9,
            "z at {}",
            pair[1].position
        );
    }
    println!(
        "{name}: worst {worst:e} N over {} rows, {modes_apart} rows in another mode",
        rows.len()
    );
    assert!(worst < LITERAL_TOLERANCE, "{worst}");
}

#[test]
fn literal_reading_matches_without_damping() {
    literal_reading_matches("ems_oracle_sigma0_tri.csv", 0.0);
}

#[test]
fn literal_reading_matches_with_damping() {
    literal_reading_matches("ems_oracle_sigma1_tri.csv", 1.0);
}

/// The same seal for the natural law: [-c, c] ends where the curve reaches F_s, straight beyond.
fn through_end_points() -> Element {
    let wide = params(0.0, 8e-3);
    let (mut low, mut high) = (4e-3, 5e-3);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if wide.deformation.mid(middle) < 1.5 {
            low = middle;
        } else {
            high = middle;
        }
    }
    Element::new(params(0.0, low)).unwrap()
}

/// Where the two readings must agree: while the seal deforms for the first time, and once sliding
/// has settled.
///
/// They must differ after each reversal. The trajectory switches to deformation at the reversal of
/// v_d although the seal is still strained beyond F_s; in the natural law slip goes on until the
/// force is back at F_s, some ten microseconds later. The deflection then differs by up to 2·β·v/K,
/// the force by that times the stiffness, until the next slide wipes it out. Beyond c the natural
/// element is straight where the trajectory follows its quintic; that changes the approach to the
/// settled force but not the force.
#[test]
fn natural_law_agrees_where_the_readings_must() {
    let Some(rows) = rows("ems_oracle_sigma0_tri.csv") else {
        return;
    };
    let element = through_end_points();
    let mut state = element.rest_state(0.0);
    let (mut first_bend, mut settled, mut apart) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut slid_rows = 0;
    let mut has_slid = false;
    let mut settled_rows = 0;
    for pair in rows.windows(2) {
        let displacement = pair[1].position - pair[0].position;
        let force = element.step(&mut state, displacement, PERIOD);
        let difference = (force - pair[1].force).abs();
        has_slid |= pair[1].sliding;
        slid_rows = if pair[0].sliding && pair[1].sliding { slid_rows + 1 } else { 0 };
        if !has_slid {
            first_bend = first_bend.max(difference);
        } else if slid_rows > 40 {
            // 40 ms are over 30 time constants β/K of this seal.
            settled = settled.max(difference);
            settled_rows += 1;
        }
        apart = apart.max(difference);
    }
    println!(
        "first bend {first_bend:e} N, settled {settled:e} N over {settled_rows} rows, anywhere {apart:.3} N"
    );
    assert!(settled_rows > 1000);
    assert!(first_bend < 1e-9);
    assert!(settled < 1e-6);
    assert!(apart < 0.4);
}
