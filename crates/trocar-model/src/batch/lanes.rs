//! [`LANES`] elements side by side: the exact step of a confined element ([`Element::step`])
//! without branches by lane.
//!
//! Every lane computes what the scalar step computes, operation by operation and in the same order,
//! so the bits are the same. What a lane cannot do without a branch (to come back from a slide
//! within a step, a number beyond all bounds) it leaves untouched and reports; the scalar step does
//! it.

use crate::ems::{Element, Mode, State};
use crate::exponential::decay;
use crate::relaxation::MAX_ARMS;

/// Elements that one [`Lanes`] holds.
pub const LANES: usize = 16;

/// One number for each lane.
pub(crate) type Lane = [f64; LANES];

const COUNT: usize = crate::elastic::COUNT;

/// Parameters and states of [`LANES`] elements, number by number: 4.6 kB. The caller owns a slice
/// of these.
#[derive(Clone, Copy, Debug)]
pub struct Lanes {
    half_width: Lane,
    yield_stiffness: Lane,
    /// M at -c and +c, N.
    end_force: [Lane; 2],
    /// Beyond an end, [withdrawal, insertion]: slope (N/m), K/β (1/s), β/K (s).
    end_stiffness: [Lane; 2],
    rate: [Lane; 2],
    lag: [Lane; 2],
    /// The span between two joins where the lane was last: [from, to), m, and M and h there.
    from: Lane,
    to: Lane,
    mid: Lane,
    inverse_half: Lane,
    mid_force: [Lane; COUNT],
    gap_force: [Lane; COUNT],
    deflection: Lane,
    yield_force: Lane,
    pub(crate) force: Lane,
    /// v_sl, m/s. In a lane that the scalar step runs: 1 while it slides, 0 while it deforms.
    pub(crate) slip: Lane,
    /// Some lane has viscous damping, or is beyond an end: the exponential is needed.
    viscous: bool,
    /// Lanes with an element; the others repeat one of them.
    pub(crate) fast: LaneSet,
}

/// What is the same for all lanes of one step.
#[derive(Clone, Copy)]
pub(crate) struct Stride {
    pub(crate) velocity: f64,
    pub(crate) time: f64,
}

/// Lanes by bit.
pub(crate) type LaneSet = u32;

/// What the lanes are about to do in a step.
#[derive(Clone, Copy)]
struct Survey {
    /// Some lane deforms and leaves the span that it holds.
    stale: bool,
    some_bend: bool,
    some_slide: bool,
}

impl Lanes {
    /// No element.
    pub const EMPTY: Self = Self {
        half_width: [0.0; LANES],
        yield_stiffness: [0.0; LANES],
        end_force: [[0.0; LANES]; 2],
        end_stiffness: [[0.0; LANES]; 2],
        rate: [[0.0; LANES]; 2],
        lag: [[0.0; LANES]; 2],
        from: [0.0; LANES],
        to: [0.0; LANES],
        mid: [0.0; LANES],
        inverse_half: [0.0; LANES],
        mid_force: [[0.0; LANES]; COUNT],
        gap_force: [[0.0; LANES]; COUNT],
        deflection: [0.0; LANES],
        yield_force: [0.0; LANES],
        force: [0.0; LANES],
        slip: [0.0; LANES],
        viscous: false,
        fast: 0,
    };

    /// Forces after the last step, N. Places past the last model mean nothing.
    #[inline(always)]
    pub fn forces(&self) -> &[f64; LANES] {
        &self.force
    }

    /// 1 for a model that slides, 0 for one that deforms, NaN for one without a mode.
    #[inline(always)]
    pub fn sliding(&self) -> [f64; LANES] {
        self.slip.map(|slip| if slip.is_nan() { slip } else { f64::from(u8::from(slip != 0.0)) })
    }

    /// The force of a model that the lanes do not run.
    pub(crate) fn show(&mut self, lane: usize, force: f64, slides: Option<bool>) {
        self.force[lane % LANES] = force;
        self.slip[lane % LANES] = slides.map_or(f64::NAN, |slides| f64::from(u8::from(slides)));
    }

    /// Whether a lane can run `element` from `state`.
    pub(crate) fn can_run(element: &Element, state: &State) -> bool {
        let own = State::stuck(state.deflection, state.yield_force, state.force, [0.0; MAX_ARMS]);
        let own = State { slip_velocity: state.slip_velocity, mode: state.mode, ..own };
        element.confined
            && *state == own
            && (state.slip_velocity != 0.0) == (state.mode == Mode::Sliding)
    }

    /// Puts `element` in `state` into `lane`.
    pub(crate) fn load(&mut self, lane: usize, element: &Element, state: &State) {
        let lane = lane % LANES;
        let deformation = &element.params.deformation;
        self.half_width[lane] = deformation.half_width();
        self.yield_stiffness[lane] = deformation.yield_stiffness();
        for (k, contact) in [&element.withdrawal, &element.insertion].into_iter().enumerate() {
            self.end_force[k][lane] = contact.end_force;
            self.end_stiffness[k][lane] = contact.end_stiffness;
            self.rate[k][lane] = contact.rate;
            self.lag[k][lane] = contact.lag;
            self.viscous |= contact.lag > 0.0;
        }
        self.store(lane, state);
        self.bring(lane, element, state.deflection);
    }

    pub(crate) fn store(&mut self, lane: usize, state: &State) {
        let lane = lane % LANES;
        self.deflection[lane] = state.deflection;
        self.yield_force[lane] = state.yield_force;
        self.force[lane] = state.force;
        self.slip[lane] = state.slip_velocity;
        self.viscous |= state.deflection.abs() > self.half_width[lane];
    }

    pub(crate) fn state(&self, lane: usize) -> State {
        let lane = lane % LANES;
        let state = State::stuck(
            self.deflection[lane],
            self.yield_force[lane],
            self.force[lane],
            [0.0; MAX_ARMS],
        );
        let slip_velocity = self.slip[lane];
        let mode = if slip_velocity == 0.0 { Mode::Deforming } else { Mode::Sliding };
        State { slip_velocity, mode, ..state }
    }

    /// Takes over the state of another lane.
    pub(crate) fn copy_state(&mut self, to: usize, from: usize) {
        let state = self.state(from);
        self.store(to, &state);
    }

    /// Brings the span around `z` into `lane`.
    pub(crate) fn bring(&mut self, lane: usize, element: &Element, z: f64) {
        let lane = lane % LANES;
        let (span, from, to) = element.params.deformation.span_around(z);
        self.from[lane] = from;
        self.to[lane] = to;
        self.mid[lane] = span.mid;
        self.inverse_half[lane] = span.inverse_half;
        for (k, [mid, gap]) in span.force.iter().enumerate() {
            self.mid_force[k][lane] = *mid;
            self.gap_force[k][lane] = *gap;
        }
    }

    /// Advances all lanes; `bring` is called for those that need another span. Returns the lanes it
    /// left untouched.
    #[inline(always)]
    pub(crate) fn advance(
        &mut self,
        stride: Stride,
        bring: impl FnOnce(&mut Self, LaneSet),
    ) -> LaneSet {
        let survey = self.survey(stride);
        if survey.stale {
            let stale = self.stale(stride);
            bring(self, stale);
        }
        match (self.viscous, survey.some_bend, survey.some_slide) {
            (_, true, false) => self.pass::<false, true, false>(stride),
            (false, true, true) => self.pass::<false, true, true>(stride),
            (false, false, _) => self.pass::<false, false, true>(stride),
            (true, true, true) => self.pass::<true, true, true>(stride),
            (true, false, _) => self.pass::<true, false, true>(stride),
        }
    }

    #[inline(always)]
    fn survey(&self, stride: Stride) -> Survey {
        let (mut stale, mut slide) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            slide[i] = if self.slides(i, stride) { 1.0 } else { 0.0 };
            stale[i] = if self.is_stale(i, stride) { 1.0 - slide[i] } else { 0.0 };
        }
        let sliding = sum(slide);
        Survey {
            stale: sum(stale) > 0.0,
            some_bend: sliding < LANES as f64,
            some_slide: sliding > 0.0,
        }
    }

    #[cold]
    fn stale(&self, stride: Stride) -> LaneSet {
        (0..LANES)
            .filter(|i| !self.slides(*i, stride) && self.is_stale(*i, stride))
            .fold(0, |set, i| set | 1 << i)
    }

    /// Where the lane goes if it deforms.
    #[inline(always)]
    pub(crate) fn target(&self, i: usize, stride: Stride) -> f64 {
        self.deflection[i] + stride.velocity * stride.time
    }

    /// Beyond an end, now or at the end of the step.
    #[inline(always)]
    fn slides(&self, i: usize, stride: Stride) -> bool {
        let (c, z, target) = (self.half_width[i], self.deflection[i], self.target(i, stride));
        (z > c) | (z < -c) | (target > c) | (target < -c)
    }

    #[inline(always)]
    fn is_stale(&self, i: usize, stride: Stride) -> bool {
        let target = self.target(i, stride);
        (target < self.from[i]) | (target >= self.to[i])
    }

    #[inline(always)]
    fn pass<const VISCOUS: bool, const DEFORMS: bool, const SLIDE: bool>(
        &mut self,
        stride: Stride,
    ) -> LaneSet {
        // Apart from what is read, so that the compiler sees lanes that do not hang together.
        let mut new = [[0.0; LANES]; 4];
        let mut size = [0.0; LANES];
        for i in 0..LANES {
            let deformed = if DEFORMS { self.deformed(i, stride) } else { Next::NONE };
            let slid = if SLIDE { self.slid::<VISCOUS>(i, stride) } else { Next::NONE };
            let next = if SLIDE && (!DEFORMS || self.slides(i, stride)) { slid } else { deformed };
            new[0][i] = next.deflection;
            new[1][i] = next.yield_force;
            new[2][i] = next.force;
            new[3][i] = next.slip;
            size[i] = next.force.abs() + next.deflection.abs() + next.unsound;
        }
        if sum(size) <= f64::MAX {
            [self.deflection, self.yield_force, self.force, self.slip] = new;
            return 0;
        }
        self.take_sound(&new, &size)
    }

    /// Takes over the lanes of finite size; returns the others.
    #[cold]
    fn take_sound(&mut self, new: &[Lane; 4], size: &Lane) -> LaneSet {
        let mut untouched = 0;
        for (i, size) in size.iter().enumerate() {
            if *size <= f64::MAX {
                self.deflection[i] = new[0][i];
                self.yield_force[i] = new[1][i];
                self.force[i] = new[2][i];
                self.slip[i] = new[3][i];
            } else {
                untouched |= 1 << i;
            }
        }
        untouched
    }

    /// [`Element::step`] without slip, in the same operations.
    #[inline(always)]
    fn deformed(&self, i: usize, stride: Stride) -> Next {
        let target = self.target(i, stride);
        let t = (target - self.mid[i]) * self.inverse_half[i];
        let mid = estrin(&self.mid_force, i, t);
        let gap = estrin(&self.gap_force, i, t).max(0.0);
        let trial = self.yield_force[i] + self.yield_stiffness[i] * (target - self.deflection[i]);
        let below = if trial < -gap { -gap } else { trial };
        let yield_force = if trial > gap { gap } else { below };
        Next { deflection: target, yield_force, force: mid + yield_force, slip: 0.0, unsound: 0.0 }
    }

    /// The slide on an end, from beyond it or from where the lane reaches it.
    #[inline(always)]
    fn slid<const VISCOUS: bool>(&self, i: usize, stride: Stride) -> Next {
        let Stride { velocity, time } = stride;
        let (c, z) = (self.half_width[i], self.deflection[i]);
        if !VISCOUS {
            let (side, s) = if velocity > 0.0 { (1, 1.0) } else { (0, -1.0) };
            let force = s * self.end_force[side][i];
            return Next {
                deflection: s * c,
                yield_force: 0.0,
                force,
                slip: velocity,
                unsound: 0.0,
            };
        }
        let target = self.target(i, stride);
        let beyond = (z > c) | (z < -c);
        let upper = if beyond { z > c } else { target > c };
        let s = if upper { 1.0 } else { -1.0 };
        // Both are read: a choice of address would not be a vector.
        let of = |pair: &[Lane; 2]| {
            let [lower_end, upper_end] = [pair[0][i], pair[1][i]];
            if upper { upper_end } else { lower_end }
        };
        let (lag, rate) = (of(&self.lag), of(&self.rate));
        let excess = if beyond { if upper { z - c } else { -z - c } } else { 0.0 };
        let over = if upper { target - c } else { target + c };
        let time = if beyond { time } else { over / velocity };
        let settled = lag * s * velocity;
        let end = settled + (excess - settled) * decay(rate * time);
        let returns = (end < 0.0) | ((end <= 0.0) & (s * velocity < 0.0));
        let end = end.max(0.0);
        Next {
            deflection: s * (c + end),
            yield_force: 0.0,
            force: s * (of(&self.end_force) + of(&self.end_stiffness) * end),
            slip: if lag > 0.0 { s * rate * end } else { velocity },
            unsound: if beyond & returns { f64::INFINITY } else { 0.0 },
        }
    }
}

/// A lane after a step.
#[derive(Clone, Copy)]
struct Next {
    deflection: f64,
    yield_force: f64,
    force: f64,
    slip: f64,
    /// 0; infinite for what only the scalar step can do.
    unsound: f64,
}

impl Next {
    const NONE: Self =
        Self { deflection: 0.0, yield_force: 0.0, force: 0.0, slip: 0.0, unsound: 0.0 };
}

/// Sum of all lanes, by halves.
#[inline(always)]
fn sum(lane: Lane) -> f64 {
    let mut sums = lane;
    for width in [LANES / 2, LANES / 4, LANES / 8, LANES / 16] {
        for i in 0..width {
            sums[i] += sums[i + width];
        }
    }
    sums[0]
}

/// As for one element, `elastic.rs`.
#[inline(always)]
fn estrin(a: &[Lane; COUNT], i: usize, t: f64) -> f64 {
    let t2 = t * t;
    let t4 = t2 * t2;
    let low = (a[0][i] + a[1][i] * t) + (a[2][i] + a[3][i] * t) * t2;
    let high = (a[4][i] + a[5][i] * t) + (a[6][i] + a[7][i] * t) * t2;
    low + high * t4
}
