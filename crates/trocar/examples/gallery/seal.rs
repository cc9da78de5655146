//! One seal: what the model does, on motions made up for the eye.

use trocar::report::{Axis, Figure, Mark, Panel, Role, Series, Width};
use trocar_model::{
    Direction, Element, ElementParams, Quantity, Relaxation, Rotation, Seal, SlidingFriction,
    State, Trocar, Tunable, step_parallel,
};

use super::{Outcome, thinned};

pub(crate) const PICTURES: [&str; 11] = [
    "annotated-loop",
    "one-reversal",
    "branches",
    "partial-reversals",
    "rests",
    "speeds",
    "stribeck",
    "stick-slip",
    "wetting",
    "two-seals",
    "turning",
];

pub(crate) fn figures() -> Outcome<Vec<Figure>> {
    Ok(vec![
        annotated_loop()?,
        one_reversal()?,
        branches()?,
        partial_reversals()?,
        rests()?,
        speeds()?,
        stribeck()?,
        stick_slip()?,
        wetting()?,
        two_seals()?,
        turning()?,
    ])
}

/// s
const STEP: f64 = 1e-3;
const MM: f64 = 1e3;

fn plausible() -> Outcome<ElementParams> {
    Ok(ElementParams::plausible_10_5_mm()?)
}

/// A seal whose forces and whose half width are those of another, times a factor each.
fn scaled(params: ElementParams, force: f64, width: f64) -> Outcome<ElementParams> {
    let seal: Seal = Element::new(params)?.into();
    let scaled = |tunable: Tunable| match tunable.id.quantity {
        Quantity::CoulombForce | Quantity::ViscousDamping => force * tunable.value,
        Quantity::HalfWidth => width * tunable.value,
        _ => tunable.value,
    };
    let values: Vec<f64> = seal.tunables().map(scaled).collect();
    let scaled = seal.tuned(&values)?;
    Ok(*scaled.stages().ok_or("the seal is an element")?.first().params())
}

/// What an element did along a motion: s, m, N, m, m/s.
struct Run {
    time: Vec<f64>,
    position: Vec<f64>,
    force: Vec<f64>,
    deflection: Vec<f64>,
    slip: Vec<f64>,
}

impl Run {
    /// `params` along intervals of constant velocity (m/s, s), from the deflection after a withdrawal.
    fn along(params: ElementParams, intervals: &[(f64, f64)]) -> Outcome<Self> {
        let element = Element::new(params)?;
        let mut state = element.rest_state(-params.deformation.half_width());
        let mut run = Self {
            time: vec![],
            position: vec![],
            force: vec![],
            deflection: vec![],
            slip: vec![],
        };
        run.keep(0.0, 0.0, &state);
        let (mut time, mut position) = (0.0, 0.0);
        for &(velocity, duration) in intervals {
            for _ in 0..(duration / STEP).round() as usize {
                element.step(&mut state, velocity * STEP, STEP);
                time += STEP;
                position += velocity * STEP;
                run.keep(time, position, &state);
            }
        }
        Ok(run)
    }

    fn keep(&mut self, time: f64, position: f64, state: &State) {
        self.time.push(time);
        self.position.push(position);
        self.force.push(state.force());
        self.deflection.push(state.deflection());
        self.slip.push(state.slip_velocity());
    }

    /// The samples from a time on, with that time as zero.
    fn from(mut self, time: f64) -> Self {
        let first = (time / STEP).round() as usize;
        let columns = [
            &mut self.time,
            &mut self.position,
            &mut self.force,
            &mut self.deflection,
            &mut self.slip,
        ];
        columns.into_iter().for_each(|column| drop(column.drain(..first)));
        let begin = self.time[0];
        self.time.iter_mut().for_each(|t| *t -= begin);
        self
    }

    fn over_time(&self, name: &str, role: Role, column: &[f64], scale: f64) -> Series {
        Series::line(name, role, thinned(&self.time, 4, 1.0), thinned(column, 4, scale))
    }

    fn over_position(&self, name: &str, role: Role) -> Series {
        Series::line(name, role, thinned(&self.position, 4, MM), thinned(&self.force, 4, 1.0))
    }
}

fn time() -> Axis {
    Axis::new("time", "s")
}

fn force() -> Axis {
    Axis::new("force", "N")
}

/// One loop with its terms.
fn annotated_loop() -> Outcome<Figure> {
    const SPEED: f64 = 0.02;
    let params = plausible()?;
    let strokes = [(SPEED, 1.5), (-SPEED, 1.5), (SPEED, 1.5), (-SPEED, 1.5)];
    let full = Run::along(params, &strokes)?.from(3.0);
    let minor = [(SPEED, 1.5), (-SPEED, 1.5), (SPEED, 0.6), (-SPEED, 0.2), (SPEED, 0.2)];
    let minor = Run::along(params, &minor)?.from(3.6);
    let snap = params.deformation.insertion().join();
    let at =
        |reached: &dyn Fn(usize) -> bool| (1..full.time.len()).find(|k| reached(*k)).unwrap_or(0);
    let join = at(&|k| full.deflection[k] >= snap);
    let back = at(&|k| k > 1500 && full.deflection[k] <= -snap);
    let labelled = |x: &[f64], points: &[(usize, &str)]| {
        let (at, words): (Vec<usize>, Vec<&str>) = points.iter().copied().unzip();
        let x = at.iter().map(|k| MM * x[*k]).collect();
        let y = at.iter().map(|k| full.force[*k]).collect();
        Series::labelled("", Role::Fit, x, y, words.into_iter().map(str::to_owned).collect())
    };
    let over_deflection = |name: &str, role, run: &Run| {
        Series::line(name, role, thinned(&run.deflection, 4, MM), thinned(&run.force, 4, 1.0))
    };
    let moved = |run: &Run, name: &str, role| {
        let x = run.position.iter().step_by(4).map(|x| MM * x).collect();
        Series::line(name, role, x, thinned(&run.force, 4, 1.0))
    };
    let c = MM * params.deformation.half_width();
    let position = Panel::new(Axis::new("position of the instrument", "mm"), force())
        .aspect(0.95)
        .series(moved(&full, "two strokes", Role::Model))
        .series(moved(&minor, "minor loop", Role::Alternative))
        .series(labelled(
            &full.position,
            &[
                (1, "reversal"),
                (join, "snap-through"),
                (1200, "sliding"),
                (1500, "reversal"),
                (2600, "sliding"),
            ],
        ))
        .mark(Mark::x_range(0.0, 2.0 * c, "full reversal, 2c"));
    let deflection = Panel::new(Axis::new("deflection z of the seal", "mm"), force())
        .aspect(0.95)
        .series(over_deflection("two strokes", Role::Model, &full))
        .series(over_deflection("minor loop", Role::Alternative, &minor))
        .series(labelled(
            &full.deflection,
            &[
                (join, "join"),
                (500, "branch of insertion"),
                (back, "join"),
                (2000, "branch of withdrawal"),
            ],
        ))
        .mark(Mark::x(-c, "−c"))
        .mark(Mark::x(c, "+c, half width"));
    Ok(Figure::new("annotated-loop", 1, "The terms of a loop")
        .columns(2)
        .panel(position)
        .panel(deflection)
        .caption(
            "An insertion and a withdrawal of the plausible seal, over the position of the instrument and over the deflection of the seal. After each \
             reversal the seal deforms over 2c along a branch, and snaps through at its join; then it slides. A partial reversal gives a minor loop.",
        ))
}

/// Force, deflection and slip while the instrument reverses.
fn one_reversal() -> Outcome<Figure> {
    const SPEED: f64 = 0.02;
    let run = Run::along(plausible()?, &[(SPEED, 1.4), (-SPEED, 1.3)])?.from(1.0);
    let params = plausible()?;
    let snap = params.deformation.withdrawal();
    let at = |deflection: f64| {
        let k = (401..run.time.len()).find(|k| run.deflection[*k] <= deflection);
        k.map_or(f64::NAN, |k| run.time[k])
    };
    let slides = (401..run.time.len()).find(|k| run.slip[*k] < -0.5 * SPEED);
    let slides = slides.map_or(f64::NAN, |k| run.time[k]);
    let marked = |panel: Panel| {
        panel.mark(Mark::x_range(0.4, slides, "deforms")).mark(Mark::x(at(snap.join()), ""))
    };
    let c = MM * params.deformation.half_width();
    let forces = marked(Panel::new(time(), force()).aspect(0.34))
        .mark(Mark::x(at(snap.join()), "snaps through"))
        .series(run.over_time("force F", Role::Model, &run.force, 1.0));
    let deflection = marked(Panel::new(time(), Axis::new("deflection", "mm")).aspect(0.22))
        .mark(Mark::y(c, "+c"))
        .mark(Mark::y(-c, "−c"))
        .series(run.over_time("deflection z of the seal", Role::Deflection, &run.deflection, MM));
    let speeds = marked(Panel::new(time(), Axis::new("velocity", "mm/s")).aspect(0.22))
        .series(run.over_time("slip velocity", Role::Fit, &run.slip, MM))
        .series(velocity_of(&run));
    Ok(Figure::new("one-reversal", 1, "One reversal of a seal")
        .panel(forces)
        .panel(deflection)
        .panel(speeds)
        .linked_x()
        .caption(
            "The instrument slides in at 20 mm/s and reverses. The seal stays with it, deforms over 2c, snaps through past its join, and \
             then slides the other way. Force, deflection z and slip velocity of the plausible seal.",
        ))
}

fn velocity_of(run: &Run) -> Series {
    let velocity: Vec<f64> =
        run.position.windows(2).map(|pair| MM * (pair[1] - pair[0]) / STEP).collect();
    let shown = velocity.iter().step_by(4).copied().collect::<Vec<_>>();
    let time = thinned(&run.time[1..], 4, 1.0);
    Series::line("velocity of the instrument", Role::Reference, time, shown)
}

/// Force over deflection with both branches.
fn branches() -> Outcome<Figure> {
    let deformation = plausible()?.deformation;
    let c = deformation.half_width();
    let grid: Vec<f64> = (-200..=200).map(|k| c * f64::from(k) / 200.0).collect();
    let line = |name: &str, role, value: &dyn Fn(f64) -> f64| {
        let y = grid.iter().map(|z| value(*z)).collect();
        Series::line(name, role, thinned(&grid, 1, MM), y)
    };
    let [insertion, withdrawal] =
        [Direction::Insertion, Direction::Withdrawal].map(|d| *deformation.branch(d));
    let joins = [insertion, withdrawal].map(|branch| branch.join());
    let at_join = |k: usize, branch: trocar_model::Branch| [MM * joins[k], branch.force(joins[k])];
    let [a, b] = [at_join(0, insertion), at_join(1, withdrawal)];
    let band = Series::band(
        "between the branches: partial reversals",
        Role::Neutral,
        thinned(&grid, 1, MM),
        grid.iter().map(|z| deformation.mid(*z) - deformation.half_gap(*z)).collect(),
        grid.iter().map(|z| deformation.mid(*z) + deformation.half_gap(*z)).collect(),
    );
    let panel = Panel::new(Axis::new("deflection z", "mm"), force())
        .aspect(0.62)
        .series(band)
        .series(line("branch of insertion", Role::Category(0), &|z| insertion.force(z)))
        .series(line("branch of withdrawal", Role::Category(1), &|z| withdrawal.force(z)))
        .series(line("middle of both", Role::Neutral, &|z| deformation.mid(z)))
        .series(Series::points(
            "joins: the seal snaps through",
            Role::Fit,
            vec![a[0], b[0]],
            vec![a[1], b[1]],
        ))
        .mark(Mark::x(-MM * c, "−c"))
        .mark(Mark::x(MM * c, "+c"));
    Ok(Figure::new("branches", 1, "Two branches").width(Width::Narrow).panel(panel).caption(
        "The force of the plausible seal over its deflection: one branch for each direction, of two joined polynomials. A full \
         reversal follows a branch from end to end; sliding begins at the half width ±c.",
    ))
}

/// Loops inside loops.
fn partial_reversals() -> Outcome<Figure> {
    const SPEED: f64 = 0.01;
    let stroke = |millimetres: f64| (SPEED * millimetres.signum(), millimetres.abs() / MM / SPEED);
    let strokes = |all: &[f64]| all.iter().map(|mm| stroke(*mm)).collect::<Vec<_>>();
    let full = Run::along(plausible()?, &strokes(&[24.0, -24.0, 24.0, -24.0]))?.from(4.8);
    let mut nested = vec![11.0];
    for length in [7.0, 5.0, 3.0, 1.5] {
        nested.extend([-length, length]);
    }
    nested.extend([13.0, -24.0]);
    let nested = Run::along(plausible()?, &strokes(&nested))?;
    let mut small = vec![24.0];
    for length in [12.0, 9.0, 6.0, 3.0] {
        small.extend([-length, length]);
    }
    let small = Run::along(plausible()?, &strokes(&small))?.from(2.4);
    let panel = |title: &str, run: &Run| {
        Panel::new(Axis::new("position", "mm"), force())
            .title(title)
            .aspect(0.8)
            .series(full.over_position("full strokes", Role::Backdrop))
            .series(run.over_position("partial reversals", Role::Model))
    };
    Ok(Figure::new("partial-reversals", 1, "Partial reversals")
        .columns(2)
        .panel(panel("while the seal deforms", &nested))
        .panel(panel("from sliding", &small))
        .caption(
            "Reversals shorter than the deformation give minor loops inside the loop of full strokes. Each closes at the turning point where it \
             began: on the way back the force meets its old curve.",
        ))
}

/// What a rest does.
fn rests() -> Outcome<Figure> {
    let kinds = |params: ElementParams| {
        let with_creep = ElementParams { creep_velocity: 3e-3, ..params };
        let relaxing = ElementParams { relaxation: Relaxation::single(150.0, 1.0), ..params };
        [
            ("EMS", Role::Reference, params),
            ("with creep", Role::Category(0), with_creep),
            ("with relaxation", Role::Category(1), relaxing),
        ]
    };
    let panel = |title: &str, intervals: &[(f64, f64)]| -> Outcome<Panel> {
        let mut panel = Panel::new(time(), force()).title(title).aspect(0.75);
        for (name, role, params) in kinds(plausible()?) {
            let run = Run::along(params, intervals)?;
            panel = panel.series(run.over_time(name, role, &run.force, 1.0));
        }
        let stop = intervals.iter().take_while(|(v, _)| *v != 0.0).map(|(_, t)| t).sum::<f64>();
        Ok(panel.mark(Mark::x_range(stop, stop + 2.0, "rest")))
    };
    Ok(Figure::new("rests", 1, "Rests")
        .columns(2)
        .panel(panel("while the seal deforms", &[(0.03, 0.48), (0.0, 2.0), (0.03, 0.4)])?)
        .panel(panel("from sliding", &[(0.03, 1.0), (0.0, 2.0), (0.03, 0.4)])?)
        .caption(
            "The instrument stops for 2 s and goes on. The element of EMS holds its force. With creep (3 mm/s) the contact slips on under load; with \
             relaxation (150 N/m, 1 s) the rubber lets go of a part of the force.",
        ))
}

/// The loop at several speeds.
fn speeds() -> Outcome<Figure> {
    let mut panel = Panel::new(Axis::new("position", "mm"), force()).aspect(0.6);
    for (k, speed) in (0..).zip([0.015_f64, 0.05, 0.1]) {
        let stroke = 0.03 / speed;
        let intervals = [(speed, stroke), (-speed, stroke), (speed, stroke), (-speed, stroke)];
        let run = Run::along(plausible()?, &intervals)?.from(2.0 * stroke);
        let step = ((0.0002 / speed / STEP) as usize).max(1);
        let (x, y) = (thinned(&run.position, step, MM), thinned(&run.force, step, 1.0));
        panel = panel.series(Series::line(format!("{} mm/s", MM * speed), Role::Category(k), x, y));
    }
    Ok(Figure::new("speeds", 1, "Speed").width(Width::Narrow).panel(panel).caption(
        "Full strokes of the plausible seal at three speeds. The deformation force does not depend on the speed; the sliding force grows with it by \
         viscous friction, β = 5 N s/m. The faster it slid, the further the seal is deflected when it reverses.",
    ))
}

fn weakening(stribeck_velocity: f64) -> SlidingFriction {
    SlidingFriction {
        coulomb_force: 2.0,
        static_force: 3.0,
        stribeck_velocity,
        stribeck_exponent: 2.0,
        viscous_damping: 5.0,
    }
}

fn stribeck() -> Outcome<Figure> {
    let speeds: Vec<f64> = (0..=240).map(|k| 0.12 * f64::from(k) / 240.0).collect();
    let line = |name: String, role, friction: SlidingFriction| {
        let y = speeds.iter().map(|v| friction.force(*v)).collect();
        Series::line(name, role, thinned(&speeds, 1, MM), y)
    };
    let mut panel =
        Panel::new(Axis::new("slip velocity", "mm/s"), force().with_zero()).aspect(0.62);
    let plain = SlidingFriction::coulomb(2.0, 5.0);
    panel = panel.series(line("Coulomb and viscous".into(), Role::Reference, plain));
    for (k, velocity) in (0..).zip([0.005, 0.02, 0.05]) {
        let name = format!("v_s = {} mm/s", MM * velocity);
        panel = panel.series(line(name, Role::Category(k), weakening(velocity)));
    }
    Ok(Figure::new("stribeck", 1, "Stribeck curve").width(Width::Narrow).panel(panel).caption(
        "Sliding force over slip velocity, equation (11): from F_s = 3 N it falls to F_c = 2 N over the Stribeck velocity v_s, and rises by viscous friction. \
         Where it falls, steady sliding is unstable.",
    ))
}

/// Sliding where the friction falls with speed, and where it does not.
fn stick_slip() -> Outcome<Figure> {
    let friction = weakening(0.02);
    let params = ElementParams { insertion: friction, withdrawal: friction, ..plausible()? };
    let run = |speed: f64| Run::along(params, &[(speed, 0.04 / speed)]);
    let panel = |speed: f64, run: &Run| {
        let step = ((0.000_02 / speed / STEP) as usize).max(1);
        let (x, y) = (thinned(&run.position, step, MM), thinned(&run.force, step, 1.0));
        Panel::new(Axis::new("position", "mm"), force())
            .title(format!("{} mm/s", MM * speed))
            .aspect(0.28)
            .series(Series::line("force", Role::Model, x, y))
            .mark(Mark::y(friction.force(speed), "sliding"))
    };
    let slow = run(0.01)?;
    let fast = run(0.06)?;
    Ok(Figure::new("stick-slip", 1, "Stick-slip")
        .panel(panel(0.01, &slow))
        .panel(panel(0.06, &fast))
        .linked_x()
        .caption(
            "The seal of the Stribeck curve with v_s = 20 mm/s. At 10 mm/s the friction falls with speed faster than damping rises: the lip sticks and \
             slips. At 60 mm/s it slides steadily at the force of the curve (dashed).",
        ))
}

/// Dry and wet.
fn wetting() -> Outcome<Figure> {
    let dry = plausible()?;
    let mut panel = Panel::new(Axis::new("position", "mm"), force()).aspect(0.62);
    for (k, scale) in (0..).zip([1.0, 0.75, 0.5]) {
        let scaled = scaled(dry, scale, scale)?;
        let strokes = [(0.02, 1.4), (-0.02, 1.4), (0.02, 1.4), (-0.02, 1.4)];
        let run = Run::along(scaled, &strokes)?.from(2.8);
        let name = if scale == 1.0 { "dry".to_owned() } else { format!("friction × {scale}") };
        panel = panel.series(run.over_position(&name, Role::Category(k)));
    }
    Ok(Figure::new("wetting", 1, "A wet seal").width(Width::Narrow).panel(panel).caption(
        "Wetting lowers the friction of the contact, here by 25 and 50 %. The rubber keeps its stiffness, so a wet seal slides after a \
         shorter deformation.",
    ))
}

/// A trocar with two seals.
fn two_seals() -> Outcome<Figure> {
    let wide = plausible()?;
    let narrow = scaled(wide, 0.5, 0.375)?;
    let elements = [Element::new(wide)?, Element::new(narrow)?];
    let mut states =
        elements.map(|element| element.rest_state(-element.params().deformation.half_width()));
    let (mut position, mut x) = (0.0, Vec::new());
    let mut forces: [Vec<f64>; 3] = Default::default();
    for velocity in [0.02, -0.02, 0.02, -0.02] {
        for _ in 0..1500 {
            position += velocity * STEP;
            let whole = step_parallel(&elements, &mut states, velocity * STEP, STEP);
            x.push(MM * position);
            forces[0].push(states[0].force());
            forces[1].push(states[1].force());
            forces[2].push(whole);
        }
    }
    let line = |name: &str, role, values: &[f64]| {
        Series::line(name, role, thinned(&x[3000..], 4, 1.0), thinned(&values[3000..], 4, 1.0))
    };
    let panel = Panel::new(Axis::new("position", "mm"), force())
        .aspect(0.62)
        .series(line("wide lip, c = 8 mm", Role::Category(0), &forces[0]))
        .series(line("narrow lip, c = 3 mm", Role::Category(1), &forces[1]))
        .series(line("both", Role::Model, &forces[2]));
    Ok(Figure::new("two-seals", 1, "A trocar with two seals").width(Width::Narrow).panel(panel).caption(
        "Two seals one behind the other grip the same shaft, so their forces add: two elements in parallel. Each slides when its own lip has \
         deformed.",
    ))
}

/// Angle (degrees), force along the shaft and around it (N) of the plausible seal, slid in by 20 mm, held and turned by half a turn.
fn turned(stiffness: f64) -> Outcome<Vec<[f64; 3]>> {
    let rotation = Rotation {
        shaft_radius: 5e-3,
        circumferential_stiffness: stiffness,
        circumferential_ratio: 1.0,
    };
    let trocar = Trocar::of_seal(Element::new(plausible()?)?).with_rotation(Some(rotation))?;
    let mut state = trocar.rest(-0.02);
    for k in 1..=1000 {
        trocar.step_to(&mut state, 2e-5 * f64::from(k) - 0.02, STEP);
    }
    trocar.step_to(&mut state, 0.0, 1.0);
    let turn = |k: u32| {
        let angle = 0.5 * f64::from(k);
        trocar.turn_to(&mut state, 0.0, angle.to_radians(), 10.0 * STEP);
        [angle, state.force(), state.torque() / rotation.shaft_radius]
    };
    Ok((0..=360).map(turn).collect())
}

/// Held and turned: the force in the ellipse, and over the angle.
fn turning() -> Outcome<Figure> {
    let column = |rows: &[[f64; 3]], k: usize| rows.iter().map(|row| row[k]).collect::<Vec<f64>>();
    let rows = turned(425.0)?;
    let limit = plausible()?.insertion.static_force;
    let around: Vec<f64> = (0..=180).map(|k| f64::from(k).to_radians()).collect();
    let ellipse = |name: &str, role, ratio: f64| {
        let x = around.iter().map(|t| limit * t.cos()).collect();
        let y = around.iter().map(|t| ratio * limit * t.sin()).collect();
        Series::line(name, role, x, y)
    };
    let marks: Vec<[f64; 3]> = [0, 60, 180, 360].iter().map(|k| rows[*k]).collect();
    let words = marks.iter().map(|row| format!("{}°", row[0])).collect();
    let circle = Panel::new(Axis::new("force along the shaft", "N"), Axis::new("around it", "N"))
        .aspect(0.52)
        .series(ellipse("K, isotropic", Role::Reference, 1.0))
        .series(ellipse("half the friction around", Role::Neutral, 0.5))
        .series(Series::line("turned", Role::Model, column(&rows, 1), column(&rows, 2)))
        .series(Series::labelled("", Role::Fit, column(&marks, 1), column(&marks, 2), words));
    let mut over_angle =
        Panel::new(Axis::new("angle", "degrees"), Axis::new("force along the shaft", "N"))
            .aspect(0.52);
    for (k, stiffness) in (0..).zip([212.5, 425.0, 850.0]) {
        let rows = turned(stiffness)?;
        let name = format!("k_t = {stiffness} N/m");
        let line = Series::line(name, Role::Category(k), column(&rows, 0), column(&rows, 1));
        over_angle = over_angle.series(line);
    }
    Ok(Figure::new("turning", 1, "Held and turned").columns(2).panel(circle).panel(over_angle).caption(
        "The plausible seal, slid in, held and turned: the force leaves the axis along the yield set K.",
    ))
}
