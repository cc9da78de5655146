/* The general step. At its end the slip speed u >= 0 on the side s solves, with EMS (8), (11) and (13),
 *   s*[F_e(z+) + arms + D(v_d - s*u)] - g(u)*rho(u) - beta*u = 0
 *   z+ = z + v_d*dt - s*dt*[theta*u + (1 - theta)*u_0]
 * and where there is none above 0 the seal sticks. */

/* M, h and their slopes at one deflection. */
typedef struct {
    double middle, gap, middle_slope, gap_slope;
} trocar_local;

static trocar_local trocar_local_at(const trocar_element *e, double z)
{
    trocar_local local;
    const trocar_span *span;
    local.middle = trocar_middle_and_gap(e, z, &local.gap);
    if (z > e->half_width_m || z < -e->half_width_m) {
        local.middle_slope = e->end_stiffness_n_m[z > 0.0];
        local.gap_slope = 0.0;
        return local;
    }
    span = trocar_span_at(e, z);
    trocar_series(span->slope_n_m, (z - span->middle_m) * span->inverse_half_1_m, &local.middle_slope,
                  &local.gap_slope);
    local.gap_slope = local.gap > 0.0 ? local.gap_slope : 0.0; /* where h is clipped it stays at zero */
    return local;
}

/* As trocar_reach, with the slope of the force for a motion that goes on. */
static double trocar_reach_with_slope(const trocar_element *e, double from, double q, double to, double *reached,
                                      double *slope)
{
    const trocar_local local = trocar_local_at(e, to);
    const double trial = q + e->yield_stiffness_n_m * (to - from);
    if (trial > local.gap) {
        *slope = local.middle_slope + local.gap_slope;
        *reached = local.gap;
    } else if (trial < -local.gap) {
        *slope = local.middle_slope - local.gap_slope;
        *reached = -local.gap;
    } else {
        *slope = local.middle_slope + e->yield_stiffness_n_m;
        *reached = trial;
    }
    return local.middle + *reached;
}

//@if damping
/* D(z') = sigma(z')*z', N, EMS (9). */
static double trocar_damping_force(const trocar_element *e, double velocity)
{
    const double speed = fabs(velocity), *s = e->seal_damping;
    return (s[0] + speed * (s[1] + speed * s[2])) * velocity;
}

/* dD/dz', N s/m. */
static double trocar_damping_slope(const trocar_element *e, double velocity)
{
    const double speed = fabs(velocity), *s = e->seal_damping;
    return s[0] + speed * (2.0 * s[1] + speed * 3.0 * s[2]);
}

//@end
//@if means
/* exp(-x), and its mean over 0 to x, (1 - exp(-x))/x, for x >= 0. */
static double trocar_decay_and_mean(double x, double *mean)
{
    double left;
//@if single
    if (x < 0.25) { /* the series is good to the last bit */
//@else
    if (x < 1.0 / 64.0) { /* the series is good to the last bit */
//@end
        const double high = 1.0 / 24.0 - x * (1.0 / 120.0 - x * (1.0 / 720.0));
        *mean = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * high));
        return 1.0 - x * *mean;
    }
    left = trocar_decay(x);
    *mean = (1.0 - left) / x;
    return left;
}

//@end
//@if arms
/* What the relaxing arms do within one step: da/dt = E*dz/dt - a/tau. */
typedef struct {
    double left[2];     /* a*exp(-t/tau), N */
    double response[2]; /* E*(tau/t)*(1 - exp(-t/tau)), N/m */
    double held, stiffness;
} trocar_step_arms;

static trocar_step_arms trocar_arms_within(const trocar_element *e, const double *forces, double duration)
{
    trocar_step_arms step;
    int i;
    step.held = 0.0;
    step.stiffness = 0.0;
    for (i = 0; i < 2; ++i) {
        step.left[i] = forces[i];
        step.response[i] = 0.0;
        if (e->arm_stiffness_n_m[i] > 0.0) {
            double mean;
            step.left[i] *= trocar_decay_and_mean(duration / e->arm_time_s[i], &mean);
            step.response[i] = e->arm_stiffness_n_m[i] * mean;
            step.held += step.left[i];
            step.stiffness += step.response[i];
        }
    }
    return step;
}

/* The force of each arm when the deflection has moved by change (m). */
static void trocar_arm_forces(const trocar_step_arms *step, double change, double *forces)
{
    int i;
    for (i = 0; i < 2; ++i) {
        forces[i] = step->left[i] + step->response[i] * change;
    }
}

//@end
/* The contact at one slip speed: g(u)*rho(u) + beta*u, its slope, and the part of F_s - F_c that it has. */
typedef struct {
    double force, slope;
//@if lag
    double rise;
//@end
} trocar_resistance;

//@if lag
/* The part of F_s - F_c within a step: kept + now*exp(-(u/v_s)^delta). */
typedef struct {
    double kept, now;
} trocar_rise;

/* For a step that starts at slip speed `speed`: exact where the curve's value changes linearly over the step. */
static trocar_rise trocar_rise_after(const trocar_element *e, const trocar_contact *c, double rise, double duration,
                                     double speed)
{
    trocar_rise after = { 0.0, 1.0 };
    if (e->friction_lag_s > 0.0) {
        double mean, before = 1.0;
        const double left = trocar_decay_and_mean(duration / e->friction_lag_s, &mean);
//@if stribeck
        if (c->surplus_force_n > 0.0) {
            before = trocar_decay(trocar_stribeck_exponent(c, speed));
        }
//@else
        (void)c;
        (void)speed;
//@end
        after.kept = rise * left + (mean - left) * before;
        after.now = 1.0 - mean;
    }
    return after;
}

static trocar_rise trocar_rise_at_start(const trocar_element *e, double rise)
{
    trocar_rise at_start = { 0.0, 1.0 };
    if (e->friction_lag_s > 0.0) {
        at_start.kept = rise;
        at_start.now = 0.0;
    }
    return at_start;
}

//@end
/* The equation for the slip speed, and what its last evaluation saw. */
typedef struct {
    const trocar_element *element;
    const trocar_contact *contact;
    double sign, velocity;
    int deforms;      /* whether the seal deforms on as it slips; if not, the elastic force is as it is */
    double elastic;   /* then */
    double z, q;      /* where the step starts, if it deforms */
    double target;    /* where it ends without slip at the end */
    double implicit;  /* theta*dt */
//@if arms
    const trocar_step_arms *arms;
//@end
//@if lag
    trocar_rise memory;
//@end
    /* Where the last slip speed ends. */
    trocar_resistance seen;
    double deflection, yield_force, force;
} trocar_balance;

/* The contact at slip speed u >= 0, EMS (11) and creep: rho(u) = u/sqrt(u^2 + v_c^2). */
static trocar_resistance trocar_resist(const trocar_balance *b, double u)
{
    const trocar_contact *c = b->contact;
    const double beta = c->viscous_damping_n_s_m;
    double level = c->coulomb_force_n, fall = 0.0;
    trocar_resistance resistance;
//@if stribeck
    if (c->surplus_force_n > 0.0) {
        const double exponent = trocar_stribeck_exponent(c, u);
        const double above = c->surplus_force_n * trocar_decay(exponent);
        level = c->coulomb_force_n + above; /* EMS (11) */
        fall = trocar_stribeck_slope(above, trocar_stribeck_growth(c, u, exponent));
    }
//@end
//@if creep
    if (b->element->creep_velocity_m_s > 0.0) {
        const double creep = b->element->creep_velocity_m_s;
//@if stribeck
        double reached = c->surplus_force_n > 0.0 ? (level - c->coulomb_force_n) / c->surplus_force_n : 1.0;
//@end
        double inverse, part, growth;
//@if lag
        resistance.rise = b->memory.kept + b->memory.now * @REACHED@;
//@if stribeck
        reached = resistance.rise;
//@end
        fall *= b->memory.now;
//@end
//@if stribeck
        level = c->coulomb_force_n + c->surplus_force_n * reached;
//@end
        inverse = 1.0 / sqrt(u * u + creep * creep);
        part = u * inverse;
        growth = creep * creep * inverse * (inverse * inverse);
        resistance.force = level * part + beta * u;
        resistance.slope = fall * part + level * growth + beta;
        return resistance;
    }
//@end
    resistance.force = level + beta * u;
    resistance.slope = fall + beta;
//@if lag
    resistance.rise = 1.0;
//@end
    return resistance;
}

/* What is left over of the force at slip speed u, EMS (13), and its slope. */
static double trocar_residual(trocar_balance *b, double u, double *slope)
{
    const double deformation_velocity = b->velocity - b->sign * u; /* EMS (8) */
    double elastic = b->elastic, softening = 0.0, drag;
    b->seen = trocar_resist(b, u);
    drag = b->seen.slope;
    if (b->deforms) {
        double stiffness;
        b->deflection = b->target - b->sign * b->implicit * u;
        elastic = trocar_reach_with_slope(b->element, b->z, b->q, b->deflection, &b->yield_force, &stiffness);
//@if arms
        elastic += b->arms->held + b->arms->stiffness * (b->deflection - b->z);
        stiffness += b->arms->stiffness;
//@end
        softening = b->implicit * stiffness;
    }
//@if damping
    elastic += trocar_damping_force(b->element, deformation_velocity);
    drag += trocar_damping_slope(b->element, deformation_velocity);
//@else
    (void)deformation_velocity;
//@end
    b->force = elastic;
    *slope = -drag - softening;
    return b->sign * elastic - b->seen.force;
}

/* A root u >= 0 of the residual, positive left of it; 0 where it is not positive at 0. It is what was evaluated last.
 * Newton steps inside a bracket; until there is one the search marches from the guess, never further at once than the
 * stride. At most 241 evaluations. */
static double trocar_find_root(trocar_balance *b, double guess, double stride, double *slope)
{
//@if single
    const double small = 1e-6 * b->contact->static_force_n;
//@else
    const double small = 1e-9 * b->contact->static_force_n;
//@end
    double u = guess, low = 0.0, high = 0.0, newton, next;
    double r = trocar_residual(b, u, slope);
    int evaluations, has_low = 0, has_high = 0, bracketed = 0;
    for (evaluations = 0; evaluations < 240; ++evaluations) {
        if ((r <= 0.0 && u == 0.0) || (fabs(r) <= small && *slope < 0.0)) {
            break;
        }
        if (r > 0.0) {
            low = u;
            has_low = 1;
        } else {
            high = u;
            has_high = 1;
        }
        if (evaluations > 100) {
            stride *= 2.0;
        }
        newton = *slope < 0.0 ? u - r / *slope : (double)NAN;
        if (has_low && has_high) {
            bracketed += 1;
            next = newton > low && newton < high && bracketed < 24 ? newton : 0.5 * (low + high);
        } else if (!has_high) {
            next = trocar_least(newton, u + trocar_least(stride, u + 1.0));
        } else {
            next = trocar_most(trocar_most(newton, u - stride), 0.0);
        }
        if (next == u) {
            break;
        }
        u = next;
        r = trocar_residual(b, u, slope);
    }
    return u;
}

/* Start of a slip: where, on which side, how fast. */
typedef struct {
    double z, q;
    trocar_local local;
//@if arms
    double arms[2];
//@end
    int side;
    double speed;
    double drag; /* beta + (g*rho)' + D' */
//@if lag
    double rise;
//@end
} trocar_onset;

static trocar_balance trocar_balance_of(const trocar_element *e, int side, double velocity)
{
    trocar_balance b;
    b.element = e;
    b.contact = &e->contact[side];
    b.sign = side ? 1.0 : -1.0;
    b.velocity = velocity;
    b.deforms = 0;
    b.elastic = b.z = b.q = b.target = b.implicit = 0.0;
//@if arms
    b.arms = 0;
//@end
//@if lag
    b.memory.kept = 0.0;
    b.memory.now = 1.0;
    b.seen.rise = 1.0;
//@end
    b.seen.force = b.seen.slope = 0.0;
    b.deflection = b.yield_force = b.force = 0.0;
    return b;
}

/* beta + min dD/dz' - now*max|g'|: above zero the slip speed is unique. */
static double trocar_least_drag(const trocar_balance *b)
{
//@if stribeck
//@if lag
    const double now = b->memory.now;
    return now > 0.0 ? b->contact->least_damping_n_s_m - now * b->contact->steepest_fall_n_s_m
                     : b->contact->least_damping_n_s_m;
//@else
    return b->contact->least_damping_n_s_m - b->contact->steepest_fall_n_s_m;
//@end
//@else
    return b->contact->least_damping_n_s_m;
//@end
}

//@if stribeck
static int trocar_is_multivalued(const trocar_balance *b)
{
    return b->contact->velocity_weakening && trocar_least_drag(b) <= 0.0;
}

//@end
/* Slip speed at a given elastic force, and the drag there. With neither beta nor sigma the speed is free. */
static double trocar_slip_at(trocar_balance *b, double elastic, double guess, double *drag)
{
    double stride = HUGE_VAL, slope, speed;
    *drag = 0.0;
    if (b->contact->force_is_free) {
        return guess;
    }
    b->elastic = elastic;
//@if stribeck
    if (trocar_is_multivalued(b)) {
        stride = 0.1 * b->contact->stribeck_velocity_m_s;
    }
//@end
    speed = trocar_find_root(b, guess, stride, &slope);
    *drag = -slope;
    return speed;
}

/* Slip speed and drag in a running slide when the velocity becomes `velocity`. The last force is the sliding force at
 * the last slip speed, EMS (13); a small change of slip speed is taken to first order. */
static double trocar_slip_after(const trocar_element *e, const trocar_element_state *state, int side, double elastic,
                                double velocity, double *drag)
{
    trocar_balance b = trocar_balance_of(e, side, velocity);
    const trocar_contact *c = b.contact;
    const double s = b.sign, last = fabs(state->slip_velocity_m_s);
    double change, drive = elastic;
    *drag = 0.0;
    if (c->force_is_free) {
        return last;
    }
    *drag = c->viscous_damping_n_s_m;
//@if stribeck
    if (c->surplus_force_n > 0.0) {
        const double level = s * state->force_n - c->viscous_damping_n_s_m * last;
        const double growth = trocar_stribeck_growth(c, last, trocar_stribeck_exponent(c, last));
        *drag = c->viscous_damping_n_s_m + trocar_stribeck_slope(level - c->coulomb_force_n, growth);
    }
//@end
//@if creep
    if (e->creep_velocity_m_s > 0.0) {
        *drag = state->contact_slope_n_s_m;
    }
//@end
//@if damping
    *drag += trocar_damping_slope(e, velocity - s * last); /* EMS (8) */
    drive += trocar_damping_force(e, velocity - s * last);
//@end
    change = s * (drive - state->force_n) / *drag;
    if (fabs(change) <= 1e-2 * last) {
        return last + change;
    }
//@if lag
    b.memory = trocar_rise_at_start(e, state->rise);
//@end
    return trocar_slip_at(&b, elastic, last, drag);
}

/* Where the slip speed at the end of the step is sought: a multivalued friction law is followed on its present branch;
 * where only the seal softens, the root of least slip is the stable one. */
static double trocar_search(const trocar_balance *b, const trocar_onset *onset, double guess, double *stride)
{
    const double least_stiffness = b->element->least_stiffness_n_m;
    double in_speed = HUGE_VAL, in_deflection = HUGE_VAL;
    int multivalued = 0;
//@if stribeck
    multivalued = trocar_is_multivalued(b);
//@end
    *stride = HUGE_VAL;
    if (!multivalued && !(least_stiffness * b->implicit + trocar_least_drag(b) <= 0.0)) {
        return guess;
    }
//@if stribeck
    if (multivalued) {
        in_speed = 0.1 * b->contact->stribeck_velocity_m_s;
    }
//@end
    if (least_stiffness <= 0.0) {
        in_deflection = 1.0 / 32.0 * b->element->half_width_m / b->implicit;
    }
    *stride = trocar_least(in_speed, in_deflection);
    return multivalued ? trocar_most(trocar_least(guess, onset->speed + in_speed), onset->speed - in_speed) : 0.0;
}

/* One implicit step with theta, EMS (14). */
static void trocar_slide_with(const trocar_element *e, trocar_element_state *state, const trocar_onset *onset,
                              double velocity, double time, @ARMS_PARAMETER@double theta, double guess)
{
    trocar_balance b = trocar_balance_of(e, onset->side, velocity);
    const double s = b.sign;
    double stride, slope, u;
    b.deforms = 1;
    b.z = onset->z;
    b.q = onset->q;
    b.target = b.z + velocity * time - s * time * (1.0 - theta) * onset->speed;
    b.implicit = theta * time;
//@if arms
    b.arms = arms;
//@end
//@if lag
    b.memory = trocar_rise_after(e, b.contact, onset->rise, time, onset->speed);
//@end
    guess = trocar_search(&b, onset, guess, &stride);
    u = trocar_find_root(&b, guess, stride, &slope);
//@if arms
    trocar_arm_forces(arms, b.deflection - b.z, state->arm_force_n);
//@end
    trocar_stick(state, b.deflection, b.yield_force, b.force);
    state->slip_velocity_m_s = s * u;
//@if creep
    state->contact_slope_n_s_m = b.seen.slope;
//@end
//@if lag
    state->rise = b.seen.rise;
//@end
    state->sliding = !(u <= @CREEP_VELOCITY@);
}

/* theta(y) = 1/(1 - exp(-y)) - 1/y: makes one step exact for a linear decay of rate y/dt. */
static double trocar_fit_theta(double y)
{
    const double y2 = y * y;
    return y < 1.0 ? 0.5 + y * (1.0 / 12.0 - y2 * (1.0 / 720.0 - y2 / 30240.0))
                   : 1.0 / (1.0 - trocar_decay(y)) - 1.0 / y;
}

/* theta from the rate K/(beta + g' + D') at the start, and the slip speed at the end if the seal does not deform. */
static double trocar_predict(const trocar_element *e, const trocar_onset *onset, double velocity, double time,
                             @ARMS_PARAMETER@double *guess)
{
    const double s = onset->side ? 1.0 : -1.0, deformation_velocity = velocity - s * onset->speed;
    double stiffness = onset->local.middle_slope, stiffening, fading = onset->drag, theta, change;
    if (deformation_velocity >= 0.0 && onset->q >= onset->local.gap) {
        stiffness += onset->local.gap_slope;
    } else if (deformation_velocity <= 0.0 && onset->q <= -onset->local.gap) {
        stiffness -= onset->local.gap_slope;
    } else {
        stiffness += e->yield_stiffness_n_m;
    }
//@if arms
    stiffness += arms->stiffness;
//@end
    stiffening = stiffness * time;
    *guess = onset->speed;
    if (stiffening <= 0.0 || onset->drag <= 0.0) {
        return 1.0;
    }
//@if creep
    if (e->creep_velocity_m_s > 0.0) {
        /* A creeping contact may let go within the step: there theta follows the drag of sliding. */
        double sliding = e->contact[onset->side].viscous_damping_n_s_m;
//@if damping
        sliding += trocar_damping_slope(e, deformation_velocity);
//@end
        fading = trocar_least(sliding, onset->drag);
    }
//@end
    theta = trocar_fit_theta(stiffening / fading);
    change = stiffening * s * deformation_velocity / (onset->drag + theta * stiffening);
    *guess = trocar_most(onset->speed + change, 0.0);
    return theta;
}

/* Whether a slide that ends at rest had slipped on where it must have stopped: a contact that slips carries at least
 * F_c, a creeping one has the sign of its slip. */
static int trocar_stops_too_late(const trocar_element *e, const trocar_onset *onset, double velocity, double time,
                                 @ARMS_PARAMETER@double theta)
{
    const double s = onset->side ? 1.0 : -1.0, slip = (1.0 - theta) * onset->speed * time;
    const double change = s * (trocar_most(s * velocity * time, 0.0) - slip);
    double reached, damping = 0.0, elastic = trocar_reach(e, onset->z, onset->q, onset->z + change, &reached);
//@if arms
    elastic += arms->held + arms->stiffness * change;
//@end
//@if damping
    damping = fabs(trocar_damping_force(e, velocity));
//@end
    return @OR_CREEPING@s * elastic < e->contact[onset->side].coulomb_force_n - damping;
}

/* Slides at `velocity` for `time`, EMS (14). */
static void trocar_slide(const trocar_element *e, trocar_element_state *state, const trocar_onset *onset,
                         double velocity, double time)
{
    trocar_onset across = *onset;
    double guess, theta, limit;
//@if arms
    const trocar_step_arms arms = trocar_arms_within(e, onset->arms, time);
//@end
    theta = trocar_predict(e, onset, velocity, time, @ARMS_ARGUMENT@&guess);
    trocar_slide_with(e, state, onset, velocity, time, @ARMS_ARGUMENT@theta, guess);
    if (state->slip_velocity_m_s == 0.0 && trocar_stops_too_late(e, onset, velocity, time, @ARMS_ARGUMENT@theta)) {
        trocar_slide_with(e, state, onset, velocity, time, @ARMS_ARGUMENT@1.0, 0.0);
    }
    across.side = !onset->side;
    across.speed = 0.0;
    limit = e->contact[across.side].static_force_n;
//@if creep
    if (e->creep_velocity_m_s > 0.0) {
        limit = 0.0;
    }
//@end
    if (state->slip_velocity_m_s == 0.0 && (across.side ? 1.0 : -1.0) * state->force_n > limit) {
        /* It stuck and then yielded the other way within the step. */
        trocar_slide_with(e, state, &across, velocity, time, @ARMS_ARGUMENT@1.0, 0.0);
    }
}

/* The force above F_s when a part of the step is over without slip. */
static double trocar_above_limit(const trocar_element *e, const trocar_element_state *state, int side,
                                 double velocity, double time, double part)
{
    const double z = state->deflection_m, moved = part * velocity * time;
    double reached, elastic = trocar_reach(e, z, state->yield_force_n, z + moved, &reached);
//@if arms
    const trocar_step_arms arms = trocar_arms_within(e, state->arm_force_n, part * time);
    double forces[2];
    trocar_arm_forces(&arms, moved, forces);
    elastic += forces[0] + forces[1];
//@end
//@if damping
    elastic += trocar_damping_force(e, velocity);
//@end
    return (side ? 1.0 : -1.0) * elastic - e->contact[side].static_force_n;
}

/* Part of the step before the force reaches F_s, EMS (12): a chord and one correction; `end` is the force above it at
 * the end. */
static double trocar_yield_fraction(const trocar_element *e, const trocar_element_state *state, int side,
                                    double velocity, double time, double end)
{
    const double start = trocar_above_limit(e, state, side, velocity, time, 0.0);
    double chord, there;
    if (start >= 0.0) {
        return 0.0;
    }
    chord = -start / (end - start);
    there = trocar_above_limit(e, state, side, velocity, time, chord);
    return there > 0.0 ? chord - chord * there / (there - start) : chord + (1.0 - chord) * -there / (end - there);
}

/* Deforms up to the yield point within the step, and slides from there; `trial` is the force without slip. */
static void trocar_yield_within(const trocar_element *e, trocar_element_state *state, double velocity, double time,
                                double trial)
{
    const double z = state->deflection_m, q = state->yield_force_n;
    const int side = !(trial < 0.0);
    trocar_balance b = trocar_balance_of(e, side, velocity);
    const double end = b.sign * trial - b.contact->static_force_n;
    const double part = trocar_yield_fraction(e, state, side, velocity, time, end);
    const double moved = part * velocity * time;
    double elastic, drive, damping = 0.0;
    trocar_onset onset;
//@if arms
    const trocar_step_arms arms = trocar_arms_within(e, state->arm_force_n, part * time);
//@end
    onset.z = z + moved;
    trocar_reach(e, z, q, onset.z, &onset.q);
    onset.local = trocar_local_at(e, onset.z);
    onset.side = side;
    elastic = onset.local.middle + onset.q;
//@if arms
    trocar_arm_forces(&arms, moved, onset.arms);
    elastic += onset.arms[0] + onset.arms[1];
//@end
//@if lag
    onset.rise = 1.0;
//@end
//@if damping
    damping = trocar_damping_force(e, velocity);
//@end
    /* Rounding must not decide whether a law that falls at once is left by a jump. */
    drive = trocar_most(b.sign * (elastic + damping), (1.0 + 1e-5) * b.contact->static_force_n);
    onset.speed = trocar_slip_at(&b, b.sign * drive - damping, 0.0, &onset.drag);
    trocar_slide(e, state, &onset, velocity, (1.0 - part) * time);
}

/* From stick: deforms with the instrument, EMS (10). */
static void trocar_leave_stick(const trocar_element *e, trocar_element_state *state, double velocity, double time)
{
    const double z = state->deflection_m, target = z + velocity * time;
    double yield_force, force = trocar_reach(e, z, state->yield_force_n, target, &yield_force);
//@if arms
    const trocar_step_arms arms = trocar_arms_within(e, state->arm_force_n, time);
    force += arms.held + arms.stiffness * (target - z);
//@end
//@if damping
    force += trocar_damping_force(e, velocity);
//@end
    if (force <= e->contact[1].static_force_n && -force <= e->contact[0].static_force_n) {
        trocar_stick(state, target, yield_force, force);
//@if arms
        trocar_arm_forces(&arms, target - z, state->arm_force_n);
//@end
    } else {
        trocar_yield_within(e, state, velocity, time, force);
    }
}

/* From a slide; the velocity may have changed since, so that it sticks at once or slips the other way. */
static void trocar_keep_sliding(const trocar_element *e, trocar_element_state *state, double velocity, double time)
{
    trocar_onset onset;
    double elastic;
    onset.side = !(state->slip_velocity_m_s < 0.0);
    onset.z = state->deflection_m;
    onset.q = state->yield_force_n;
    onset.local = trocar_local_at(e, onset.z);
    elastic = onset.local.middle + onset.q;
//@if arms
    onset.arms[0] = state->arm_force_n[0];
    onset.arms[1] = state->arm_force_n[1];
    elastic += onset.arms[0] + onset.arms[1];
//@end
//@if lag
    onset.rise = state->rise;
//@end
    onset.speed = trocar_slip_after(e, state, onset.side, elastic, velocity, &onset.drag);
    if (onset.speed == 0.0) {
//@if creep
        if (e->creep_velocity_m_s > 0.0) {
            trocar_balance b = trocar_balance_of(e, !onset.side, velocity);
//@if lag
            b.memory = trocar_rise_at_start(e, state->rise);
//@end
            onset.side = !onset.side;
            onset.speed = trocar_slip_at(&b, elastic, 0.0, &onset.drag);
            trocar_slide(e, state, &onset, velocity, time);
            return;
        }
//@end
        trocar_leave_stick(e, state, velocity, time);
        return;
    }
    trocar_slide(e, state, &onset, velocity, time);
}

//@if dwell
/* The age of the contact, d(age)/dt = 1 - |v_sl|*age/D with D = c/8, after a slip within `time`. */
static double trocar_age_after(const trocar_element *e, double age, double slip, double time)
{
    double mean;
    const double left = trocar_decay_and_mean(slip / (0.125 * e->half_width_m), &mean);
    return trocar_least(age * left + time * mean, trocar_greatest);
}

static void trocar_raise(trocar_contact *c, double more)
{
    c->coulomb_force_n += more;
    c->static_force_n += more;
//@if stribeck
    c->surplus_force_n = c->static_force_n - c->coulomb_force_n;
//@end
}

/* The element within a part of `time` that begins at the slip speed `speed`: higher by Delta F*ln(1 + age/(1 s)). */
static trocar_element trocar_aged(const trocar_element *e, double age, double speed, double time)
{
    trocar_element aged = *e;
    const double more =
        e->dwell_force_n * trocar_logarithm_of_one_plus(trocar_age_after(e, age, speed * time, time));
    trocar_raise(&aged.contact[0], more);
    trocar_raise(&aged.contact[1], more);
//@if turning
    trocar_raise(&aged.around,
                 e->around.static_force_n / (0.5 * (e->contact[1].static_force_n + e->contact[0].static_force_n))
                     * (aged.contact[1].coulomb_force_n - e->contact[1].coulomb_force_n));
//@end
    return aged;
}

//@end
static void trocar_advance_part(const trocar_element *e, trocar_element_state *state, double velocity, double time)
{
    if (state->slip_velocity_m_s == 0.0@UNLESS_CREEPING@) {
        trocar_leave_stick(e, state, velocity, time);
    } else {
        trocar_keep_sliding(e, state, velocity, time);
    }
}

/* `count` parts of `time`. */
static void trocar_advance_evenly(const trocar_element *e, trocar_element_state *state, double velocity, double time,
                                  int count)
{
    int part;
    for (part = 0; part < count; ++part) {
//@if dwell
        if (e->dwell_force_n > 0.0) {
            const double each = time / (double)count, z = state->deflection_m, age = state->contact_age_s;
            const trocar_element aged = trocar_aged(e, age, fabs(state->slip_velocity_m_s), each);
            trocar_advance_part(&aged, state, velocity, each);
            state->contact_age_s =
                trocar_age_after(e, age, fabs(velocity * each - (state->deflection_m - z)), each);
            continue;
        }
//@end
        trocar_advance_part(e, state, velocity, time / (double)count);
    }
}

/* The general step in parts of at most c/8 of travel; past 32 of them the rest is divided evenly into 32. */
static void trocar_advance_general(const trocar_element *e, trocar_element_state *state, double velocity, double time)
{
    const double strides = fabs(velocity) * time / (0.125 * e->half_width_m);
    if (fabs(velocity) * time <= 0.125 * e->half_width_m) {
        trocar_advance_evenly(e, state, velocity, time, 1);
    } else if (strides <= 32.0) {
        const int below = (int)strides;
        trocar_advance_evenly(e, state, velocity, time, (double)below < strides ? below + 1 : below);
    } else {
        const double first = time * 32.0 / strides;
        trocar_advance_evenly(e, state, velocity, first, 32);
        trocar_advance_evenly(e, state, velocity, time - first, 32);
    }
}

