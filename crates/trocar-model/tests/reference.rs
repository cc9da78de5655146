//! Trajectories of an EMS element written by another author from the paper alone, single-valued deformation curve.

use std::path::PathBuf;

use trocar_model::{
    Branch, DeformationForce, Element, ElementParams, LiteralState, Mode, PaperLiteral, Piece,
    SealDamping, SlidingFriction,
};

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
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared/vectors")
        .join(name);
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) => {
            let required = std::env::var("TROCAR_REQUIRE_SHARED").is_ok_and(|value| value == "1");
            assert!(!required, "{}: {error}", path.display());
            println!("skipped: {}: {error}", path.display());
            return None;
        }
    };
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
    let monomial = [
        0.0,
        a * 49.0 * 1e3,
        0.0,
        -a * 65.0 / 12.0 * 1e9,
        0.0,
        a / 5.0 * 1e15,
    ];
    let left = Piece::from_monomial(-half_width, 0.0, &monomial).unwrap();
    let right = Piece::from_monomial(0.0, half_width, &monomial).unwrap();
    let branch = Branch::new(left, right).unwrap();
    let sliding = SlidingFriction::coulomb(1.5, 2.0);
    ElementParams {
        deformation: DeformationForce::new(branch, branch, None).unwrap(),
        damping: SealDamping::constant(sigma),
        insertion: sliding,
        withdrawal: sliding,
    }
}

fn literal_reading_matches(name: &str, sigma: f64) {
    let Some(rows) = rows(name) else { return };
    let element = PaperLiteral::new(params(sigma, 8e-3)).unwrap();
    let mut state = LiteralState::new(0.0);
    let (mut worst, mut modes_apart) = (0.0_f64, 0);
    for pair in rows.windows(2) {
        let velocity = (pair[1].position - pair[0].position) / PERIOD;
        // A row holds the state at the start of its interval and the force with the velocity of the interval.
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
