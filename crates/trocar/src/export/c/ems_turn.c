/* The step of an element that also turns: x along the axis, t around the shaft, both at its surface. At its end the slip
 * velocity v solves
 *   P(z+) = f(v) + beta*v       P = (F_e(z_x+) + arms + D(x' - v_x), k_t*z_t+), v normal to the yield set at f
 *   z+ = z + V*dt - dt*[theta*v + (1 - theta)*v_0]      theta: one along v_0, one across it
 * by Newton's method; where it does not arrive, by searches for the implicit step. */

typedef struct {
    double x, t;
} trocar_pair;

static double trocar_length(trocar_pair pair)
{
    return sqrt(pair.x * pair.x + pair.t * pair.t);
}

/* Rows x and t. */
typedef struct {
    double xx, xt, tx, tt;
} trocar_matrix;

static trocar_pair trocar_solve(trocar_matrix m, trocar_pair right)
{
    const double inverse = 1.0 / (m.xx * m.tt - m.xt * m.tx);
    const trocar_pair found = { (m.tt * right.x - m.xt * right.t) * inverse,
                                (m.xx * right.t - m.tx * right.x) * inverse };
    return found;
}

/* A slide within one motion: all of the equation but v. */
typedef struct {
    trocar_pair z, slip, onset; /* at its start: z, v_0 and, where the slip begins, its direction */
    double q;
    trocar_pair motion, target; /* target: z + V*dt - dt*(1 - theta)*v_0 */
    double time;
    trocar_matrix weight; /* dt*theta */
//@if arms
    double arm_force_n[2];
    trocar_step_arms arms;
//@end
//@if lag
    double rise;
    trocar_rise memory;
//@end
} trocar_turn;

/* The contact at one slip velocity: f + beta*v and its derivatives. */
typedef struct {
    trocar_pair force;
    trocar_matrix slope;
//@if lag
    double rise;
//@end
} trocar_touch;

/* Where a slide ends with some slip velocity. */
typedef struct {
    trocar_pair slip, z, force, residual;
    double q;
    trocar_matrix slope; /* of the residual, by -v */
    trocar_touch touch;
} trocar_end;

static int trocar_creeps(const trocar_element *e)
{
//@if creep
    return e->creep_velocity_m_s > 0.0;
//@else
    (void)e;
    return 0;
//@end
}

//@if stribeck
/* Whether the friction law depends on the speed. */
static int trocar_falls(const trocar_element *e)
{
    return e->contact[0].surplus_force_n > 0.0 || e->contact[1].surplus_force_n > 0.0;
}

//@end
static const trocar_contact *trocar_contact_for(const trocar_element *e, double force)
{
    return &e->contact[!(force < 0.0)];
}

/* g and dg/du at speed u. Around the shaft a creeping contact has as much of F_s - F_c as along the axis, *rise. */
static double trocar_turn_level(const trocar_element *e, const trocar_turn *turn, const trocar_contact *c, double u,
                                int is_around, double *rise, double *fall)
{
    double level = c->coulomb_force_n;
    *fall = 0.0;
//@if stribeck
    if (c->surplus_force_n > 0.0) {
        const double exponent = trocar_stribeck_exponent(c, u);
        const double above = c->surplus_force_n * trocar_decay(exponent);
        level = c->coulomb_force_n + above; /* EMS (11) */
        *fall = trocar_stribeck_slope(above, trocar_stribeck_growth(c, u, exponent));
    }
//@else
    (void)u;
//@end
//@if creep
    if (trocar_creeps(e)) {
        double kept = 0.0, now = 1.0;
//@if lag
        kept = turn->memory.kept;
        now = turn->memory.now;
//@else
        (void)turn;
//@end
        if (!is_around) {
//@if stribeck
            *rise = kept + now * (c->surplus_force_n > 0.0 ? (level - c->coulomb_force_n) / c->surplus_force_n : 1.0);
//@else
            *rise = kept + now;
//@end
        }
        *fall *= is_around ? 0.0 : now;
//@if stribeck
        level = c->coulomb_force_n + c->surplus_force_n * *rise;
//@end
    }
//@else
    (void)e;
    (void)turn;
    (void)is_around;
    (void)rise;
//@end
    return level;
}

static trocar_touch trocar_touch_at(const trocar_element *e, const trocar_turn *turn, trocar_pair slip)
{
    const trocar_contact *along = trocar_contact_for(e, slip.x), *around = &e->around;
    double rise = 1.0, fall_x, fall_t, level_x, level_t, inverse, secant_x, secant_t, cross, x2, t2;
//@if stribeck
    const double speed = trocar_falls(e) ? trocar_length(slip) : 0.0;
//@else
    const double speed = 0.0;
//@end
    trocar_touch touch;
    level_x = trocar_turn_level(e, turn, along, speed, 0, &rise, &fall_x);
    level_t = trocar_turn_level(e, turn, around, speed, 1, &rise, &fall_t);
//@if creep
    x2 = slip.x * slip.x + e->creep_velocity_m_s * e->creep_velocity_m_s;
//@else
    x2 = slip.x * slip.x;
//@end
    t2 = slip.t * slip.t;
    inverse = 1.0 / sqrt(level_x * level_x * x2 + level_t * level_t * t2);
    secant_x = level_x * level_x * inverse;
    secant_t = level_t * level_t * inverse;
    touch.force.x = secant_x * slip.x;
    touch.force.t = secant_t * slip.t;
    cross = -touch.force.x * touch.force.t * inverse;
    touch.slope.xx = secant_x - touch.force.x * touch.force.x * inverse;
    touch.slope.xt = cross;
    touch.slope.tx = cross;
    touch.slope.tt = secant_t - touch.force.t * touch.force.t * inverse;
    if ((fall_x != 0.0 || fall_t != 0.0) && speed > 0.0) {
        const double common = (level_x * fall_x * x2 + level_t * fall_t * t2) * (inverse * inverse);
        const double by_x = touch.force.x * (2.0 * fall_x / level_x - common);
        const double by_t = touch.force.t * (2.0 * fall_t / level_t - common);
        touch.slope.xx += by_x * slip.x / speed;
        touch.slope.xt += by_x * slip.t / speed;
        touch.slope.tx += by_t * slip.x / speed;
        touch.slope.tt += by_t * slip.t / speed;
    }
    touch.slope.xx += along->viscous_damping_n_s_m;
    touch.slope.tt += around->viscous_damping_n_s_m;
    touch.force.x += along->viscous_damping_n_s_m * slip.x;
    touch.force.t += around->viscous_damping_n_s_m * slip.t;
//@if lag
    touch.rise = rise;
//@end
    return touch;
}

/* The same slide without slip within `time`. */
static trocar_turn trocar_stuck_turn(const trocar_element *e, const trocar_turn *from, trocar_pair motion, double time)
{
    trocar_turn turn = *from;
    turn.motion = motion;
    turn.time = time;
    turn.target.x = turn.z.x + motion.x * time;
    turn.target.t = turn.z.t + motion.t * time;
    turn.weight.xx = turn.weight.tt = time;
    turn.weight.xt = turn.weight.tx = 0.0;
//@if arms
    turn.arms = trocar_arms_within(e, turn.arm_force_n, time);
//@else
    (void)e;
//@end
//@if lag
    turn.memory.kept = 0.0;
    turn.memory.now = 1.0;
//@end
    return turn;
}

/* P at the end without slip. */
static trocar_pair trocar_turn_elastic(const trocar_element *e, const trocar_turn *turn)
{
    double reached;
    trocar_pair force;
    force.x = trocar_reach(e, turn->z.x, turn->q, turn->target.x, &reached);
//@if arms
    force.x += turn->arms.held + turn->arms.stiffness * (turn->target.x - turn->z.x);
//@end
//@if damping
    force.x += trocar_damping_force(e, turn->motion.x);
//@end
    force.t = e->around_stiffness_n_m * turn->target.t;
    return force;
}

/* Whether a force lies in the yield set at rest. */
static int trocar_turn_holds(const trocar_element *e, trocar_pair force)
{
    const double limit_x = trocar_contact_for(e, force.x)->static_force_n, limit_t = e->around.static_force_n;
    const double x = force.x * limit_t, t = force.t * limit_x;
    return x * x + t * t <= (limit_x * limit_t) * (limit_x * limit_t);
}

/* How much of the yield set at rest a force takes up: 1 on its boundary. */
static double trocar_utilisation(const trocar_element *e, trocar_pair force)
{
    const trocar_pair part = { force.x / trocar_contact_for(e, force.x)->static_force_n,
                               force.t / e->around.static_force_n };
    return trocar_length(part);
}

/* Outward normal of the yield set at a force. */
static trocar_pair trocar_normal(const trocar_element *e, trocar_pair force)
{
    const double limit_x = trocar_contact_for(e, force.x)->static_force_n, limit_t = e->around.static_force_n;
    trocar_pair normal = { force.x / (limit_x * limit_x), force.t / (limit_t * limit_t) };
    const double size = trocar_length(normal);
    normal.x /= size;
    normal.t /= size;
    return normal;
}

static trocar_end trocar_end_at(const trocar_element *e, const trocar_turn *turn, trocar_pair slip)
{
    const trocar_matrix *w = &turn->weight;
    double stiffness;
    trocar_end end;
    end.slip = slip;
    end.z.x = turn->target.x - w->xx * slip.x - w->xt * slip.t;
    end.z.t = turn->target.t - w->tx * slip.x - w->tt * slip.t;
    end.force.x = trocar_reach_with_slope(e, turn->z.x, turn->q, end.z.x, &end.q, &stiffness);
    end.force.t = e->around_stiffness_n_m * end.z.t;
//@if arms
    end.force.x += turn->arms.held + turn->arms.stiffness * (end.z.x - turn->z.x);
    stiffness += turn->arms.stiffness;
//@end
//@if damping
    end.force.x += trocar_damping_force(e, turn->motion.x - slip.x); /* EMS (8) */
//@end
    end.touch = trocar_touch_at(e, turn, slip);
    end.residual.x = end.force.x - end.touch.force.x;
    end.residual.t = end.force.t - end.touch.force.t;
    end.slope = end.touch.slope;
    end.slope.xx += stiffness * w->xx;
    end.slope.xt += stiffness * w->xt;
    end.slope.tx += e->around_stiffness_n_m * w->tx;
    end.slope.tt += e->around_stiffness_n_m * w->tt;
//@if damping
    end.slope.xx += trocar_damping_slope(e, turn->motion.x - slip.x);
//@end
    return end;
}

/* A last change of the slip velocity, to first order but for the deformation. */
static void trocar_move_end(const trocar_element *e, const trocar_turn *turn, trocar_pair more, trocar_end *end)
{
    const trocar_matrix *w = &turn->weight;
    end->z.x = end->z.x + (-w->xx * more.x - w->xt * more.t);
    end->z.t = end->z.t + (-w->tx * more.x - w->tt * more.t);
    end->slip.x = end->slip.x + more.x;
    end->slip.t = end->slip.t + more.t;
    end->force.x = trocar_reach(e, turn->z.x, turn->q, end->z.x, &end->q);
    end->force.t = e->around_stiffness_n_m * end->z.t;
//@if arms
    end->force.x += turn->arms.held + turn->arms.stiffness * (end->z.x - turn->z.x);
//@end
//@if damping
    end->force.x += trocar_damping_force(e, turn->motion.x - end->slip.x);
//@end
}

/* A slip velocity changed by `more`; where the friction law may fall at most doubled or halved, but for the slowest slip:
 * such a law has two stable branches with an unstable one between them, and the present one is followed. */
static trocar_pair trocar_turn_follow(const trocar_element *e, trocar_pair slip, trocar_pair more)
{
//@if stribeck
    if (trocar_falls(e)) {
        const double change = more.x * more.x + more.t * more.t, size = slip.x * slip.x + slip.t * slip.t;
        const double feature = 0.1 * trocar_contact_for(e, slip.x)->stribeck_velocity_m_s;
        const int grows = slip.x * more.x + slip.t * more.t > 0.0;
        const double most = trocar_most(grows ? size : 0.25 * size, feature * feature);
        if (!(change <= most)) {
            const double part = sqrt(most / change);
            more.x = part * more.x;
            more.t = part * more.t;
        }
    }
//@else
    (void)e;
//@end
    slip.x = slip.x + more.x;
    slip.t = slip.t + more.t;
    return slip;
}

/* Newton's method from a slip velocity; 0 where it does not arrive, or at a root that is not stable. */
static int trocar_newton(const trocar_element *e, const trocar_turn *turn, trocar_pair slip, trocar_end *end)
{
    const double withdrawal = e->contact[0].static_force_n, insertion = e->contact[1].static_force_n;
//@if single
    const double small = 1e-6 * trocar_least(insertion, withdrawal), near = 1e2 * small;
//@else
    const double small = 1e-9 * trocar_least(insertion, withdrawal), near = 1e5 * small;
//@end
    int k;
    for (k = 0; k < 10; ++k) {
        trocar_pair more;
        *end = trocar_end_at(e, turn, slip);
        if (!(end->slope.xx * end->slope.tt - end->slope.xt * end->slope.tx > 0.0
              && end->slope.xx + end->slope.tt > 0.0)) {
            return 0;
        }
        if (fabs(end->residual.x) <= small && fabs(end->residual.t) <= small) {
            return 1;
        }
        more = trocar_solve(end->slope, end->residual);
        if (fabs(end->residual.x) <= near && fabs(end->residual.t) <= near
            && more.x * more.x + more.t * more.t <= 1e-7 * (slip.x * slip.x + slip.t * slip.t)) {
            trocar_move_end(e, turn, more, end);
            return 1;
        }
        slip = trocar_turn_follow(e, slip, more);
    }
    return 0;
}

/* Slip velocity in a direction for the force `trial` without slip, where the seal is straight. */
static trocar_pair trocar_turn_guess(const trocar_element *e, const trocar_turn *turn, trocar_pair trial,
                                     trocar_pair direction)
{
    const trocar_contact *along = trocar_contact_for(e, direction.x);
    const double excess = trocar_most(trocar_utilisation(e, trial) - 1.0, 1e-5) * along->coulomb_force_n;
    const double stiffness = trocar_most(e->yield_stiffness_n_m, e->around_stiffness_n_m);
    const double drag = along->viscous_damping_n_s_m + stiffness * turn->time;
    const double speed = drag > 0.0 ? excess / drag : along->stribeck_velocity_m_s;
    const trocar_pair guess = { speed * direction.x, speed * direction.t };
    return guess;
}

/* dF_e/dz at the start, for a motion of the seal in the direction of `velocity`. */
static double trocar_one_sided_stiffness(const trocar_element *e, const trocar_turn *turn, double velocity)
{
    const trocar_local local = trocar_local_at(e, turn->z.x);
    if (velocity >= 0.0 && turn->q >= local.gap) {
        return local.middle_slope + local.gap_slope;
    }
    if (velocity <= 0.0 && turn->q <= -local.gap) {
        return local.middle_slope - local.gap_slope;
    }
    return local.middle_slope + e->yield_stiffness_n_m;
}

/* The slide with theta along and across v_0, and to first order the slip velocity at its end. */
static trocar_turn trocar_weigh(const trocar_element *e, const trocar_turn *implicit, trocar_pair *guess)
{
    const double n = implicit->onset.x, t = implicit->onset.t, time = implicit->time;
    const double deforming = implicit->motion.x - implicit->slip.x, k_t = e->around_stiffness_n_m;
    const trocar_pair v = implicit->slip;
    const double beta = trocar_contact_for(e, v.x + n)->viscous_damping_n_s_m, square = v.x * v.x + v.t * v.t;
    const int slips = !(implicit->slip.x == 0.0 && implicit->slip.t == 0.0);
    double k_x = trocar_one_sided_stiffness(e, implicit, deforming), damping = 0.0, drag;
    double nn = n * n, nt = n * t, tt = t * t, along, across, theta, theta_across, more, kept;
    trocar_touch touch;
    trocar_turn fitted = *implicit;
//@if arms
    k_x += implicit->arms.stiffness;
//@end
    if (square >= 1e-30) {
        const double inverse = 1.0 / square;
        nn = v.x * v.x * inverse;
        nt = v.x * v.t * inverse;
        tt = v.t * v.t * inverse;
    }
    along = k_x * nn + k_t * tt;
    across = k_x * tt + k_t * nn;
    /* A force that depends on the direction of the slip alone has no slope along it. */
    drag = beta * nn + e->around.viscous_damping_n_s_m * tt;
    if (slips) {
        touch = trocar_touch_at(e, implicit, implicit->slip);
//@if stribeck
        if (!trocar_creeps(e) && trocar_falls(e)) {
            drag = touch.slope.xx * nn + (touch.slope.xt + touch.slope.tx) * nt + touch.slope.tt * tt;
        }
//@end
    }
//@if damping
    damping = trocar_damping_slope(e, deforming);
//@end
    drag = drag + damping * nn;
    theta = along > 0.0 && drag > 0.0 ? trocar_fit_theta(along * time / drag) : 1.0;
    theta_across = across * (trocar_length(implicit->motion) * time / e->around.coulomb_force_n);
    theta_across = trocar_fit_theta(trocar_most(theta_across, 0.0));
    more = theta - theta_across;
    kept = (1.0 - theta) * time;
    fitted.weight.xx = time * (theta_across + more * nn);
    fitted.weight.xt = fitted.weight.tx = time * more * nt;
    fitted.weight.tt = time * (theta_across + more * tt);
    fitted.target.x = implicit->target.x - kept * implicit->slip.x;
    fitted.target.t = implicit->target.t - kept * implicit->slip.t;
    if (slips) {
        const trocar_matrix *w = &fitted.weight;
        trocar_pair missing;
        missing.x = k_x * time * deforming;
        missing.t = k_t * time * (implicit->motion.t - implicit->slip.t);
        touch.slope.xx += damping;
        touch.slope.xx += k_x * w->xx;
        touch.slope.xt += k_x * w->xt;
        touch.slope.tx += k_t * w->tx;
        touch.slope.tt += k_t * w->tt;
        *guess = trocar_turn_follow(e, implicit->slip, trocar_solve(touch.slope, missing));
    } else {
        *guess = trocar_turn_guess(e, implicit, trocar_turn_elastic(e, implicit), implicit->onset);
    }
    return fitted;
}

/* A search as trocar_find_root, one evaluation after the other. */
typedef struct {
    double u, stride, small, low, high;
    int evaluations, has_low, has_high, bracketed;
} trocar_root;

static trocar_root trocar_root_from(double guess, double stride, double small)
{
    trocar_root root;
    root.u = guess;
    root.stride = stride;
    root.small = small;
    root.low = root.high = 0.0;
    root.evaluations = root.has_low = root.has_high = root.bracketed = 0;
    return root;
}

/* Moves u where the residual there is r with this slope; 0 where u is the root or the search ends. */
static int trocar_root_moves(trocar_root *root, double r, double slope)
{
    const double u = root->u, newton = slope < 0.0 ? u - r / slope : (double)NAN;
    double next;
    if ((r <= 0.0 && u == 0.0) || (fabs(r) <= root->small && slope < 0.0) || root->evaluations == 240) {
        return 0;
    }
    if (r > 0.0) {
        root->low = u;
        root->has_low = 1;
    } else {
        root->high = u;
        root->has_high = 1;
    }
    if (root->evaluations > 100) {
        root->stride *= 2.0;
    }
    root->evaluations += 1;
    if (root->has_low && root->has_high) {
        root->bracketed += 1;
        next = newton > root->low && newton < root->high && root->bracketed < 24 ? newton
                                                                              : 0.5 * (root->low + root->high);
    } else if (!root->has_high) {
        next = trocar_least(newton, u + trocar_least(root->stride, u + 1.0));
    } else {
        next = trocar_most(trocar_most(newton, u - root->stride), 0.0);
    }
    if (next == u) {
        return 0;
    }
    root->u = next;
    return 1;
}

/* An end sought by the speed of the slip and its direction. */
typedef struct {
    trocar_end end;
    double balance, by_speed; /* missing along the slip; its derivative by the speed where none is missing across */
    double imbalance, by_part; /* missing across the slip; its derivative by the part of the direction */
} trocar_towards;

static double trocar_dot(trocar_pair a, trocar_pair b)
{
    return a.x * b.x + a.t * b.t;
}

static trocar_pair trocar_times(const trocar_matrix *m, trocar_pair right)
{
    const trocar_pair product = { m->xx * right.x + m->xt * right.t, m->tx * right.x + m->tt * right.t };
    return product;
}

/* As trocar_end_at, at a slip speed towards v/|v| ~ (1 - part, part) on `side`. */
static trocar_towards trocar_end_towards(const trocar_element *e, const trocar_turn *turn, trocar_pair side,
                                         double speed, double part)
{
    const trocar_pair from = { 1.0 - part, part };
    const double size = trocar_length(from);
    const trocar_pair along = { side.x * (1.0 - part) / size, side.t * part / size };
    const trocar_pair across = { -side.x * part / size, side.t * (1.0 - part) / size };
    const trocar_pair slip = { speed * along.x, speed * along.t };
    trocar_pair by_along, by_across;
    trocar_towards to;
    double turning, follows;
    to.end = trocar_end_at(e, turn, slip);
    by_along = trocar_times(&to.end.slope, along);
    by_across = trocar_times(&to.end.slope, across);
    to.balance = trocar_dot(along, to.end.residual);
    to.imbalance = trocar_dot(across, to.end.residual);
    turning = speed * trocar_dot(across, by_across) + to.balance;
    follows = speed * trocar_dot(along, by_across) * trocar_dot(across, by_along) / turning;
    to.by_speed = follows - trocar_dot(along, by_along);
    to.by_part = -turning / (size * size);
    return to;
}

/* The implicit step by a search over the slip speed from the stick side, and for each by one over its direction, between
 * the axis (0) and the circumference (1) on the side of the force. */
static trocar_end trocar_search_turn(const trocar_element *e, const trocar_turn *turn)
{
    const trocar_pair trial = trocar_turn_elastic(e, turn), normal = trocar_normal(e, trial);
    const trocar_contact *contact = trocar_contact_for(e, trial.x);
    const trocar_pair side = { trial.x < 0.0 ? -1.0 : 1.0, trial.t > 0.0 ? 1.0 : trial.t < 0.0 ? -1.0 : 0.0 };
//@if single
    const double small = 1e-6 * contact->static_force_n;
//@else
    const double small = 1e-9 * contact->static_force_n;
//@end
    double in_speed = HUGE_VAL, in_deflection = HUGE_VAL, part, stride, guess, r, slope;
    trocar_root root, direction;
    trocar_towards last;
//@if stribeck
    trocar_balance b = trocar_balance_of(e, !(trial.x < 0.0), turn->motion.x);
//@if lag
    b.memory = turn->memory;
//@end
    if (trocar_is_multivalued(&b)) {
        in_speed = 0.1 * contact->stribeck_velocity_m_s;
    }
//@end
    if (e->least_stiffness_n_m <= 0.0 && turn->time > 0.0) {
        in_deflection = 1.0 / 32.0 * e->half_width_m / turn->time;
    }
    stride = trocar_least(in_speed, in_deflection);
    part = fabs(normal.t) / (fabs(normal.x) + fabs(normal.t));
    last = trocar_end_towards(e, turn, side, 0.0, part);
    guess = trocar_length(trocar_turn_guess(e, turn, trial, normal));
    root = trocar_root_from(trocar_least(guess, stride), stride, small);
    do {
        r = trocar_length(trial); /* at 0: outside the yield set there is always slip */
        slope = (double)NAN;
        if (root.u != 0.0) {
            direction = trocar_root_from(part, 0.5, small);
            do {
                last = trocar_end_towards(e, turn, side, root.u, trocar_least(direction.u, 1.0));
            } while (trocar_root_moves(&direction, last.imbalance, last.by_part));
            part = trocar_least(direction.u, 1.0);
            r = last.balance;
            slope = last.by_speed;
        }
    } while (trocar_root_moves(&root, r, slope));
    return last.end;
}

static void trocar_stick_turn(const trocar_element *e, trocar_element_state *state, const trocar_turn *turn,
                              trocar_pair force)
{
    double q;
    trocar_reach(e, turn->z.x, turn->q, turn->target.x, &q);
    trocar_stick(state, turn->target.x, q, force.x);
//@if arms
    trocar_arm_forces(&turn->arms, turn->target.x - turn->z.x, state->arm_force_n);
//@end
    state->around_deflection_m = turn->target.t;
    state->around_slip_velocity_m_s = 0.0;
}

static void trocar_end_turn(const trocar_element *e, trocar_element_state *state, const trocar_turn *turn,
                            const trocar_end *end)
{
    trocar_stick(state, end->z.x, end->q, end->force.x);
    state->slip_velocity_m_s = end->slip.x;
//@if creep
    state->contact_slope_n_s_m = end->touch.slope.xx;
//@end
//@if lag
    state->rise = end->touch.rise;
//@end
//@if arms
    trocar_arm_forces(&turn->arms, end->z.x - turn->z.x, state->arm_force_n);
//@else
    (void)turn;
//@end
    state->sliding = !(end->slip.x == 0.0 && end->slip.t == 0.0);
//@if creep
    if (trocar_creeps(e)) {
        state->sliding = !(trocar_length(end->slip) <= e->creep_velocity_m_s);
    }
//@else
    (void)e;
//@end
    state->around_deflection_m = end->z.t;
    state->around_slip_velocity_m_s = end->slip.t;
}

/* Slides from `start` with its slip velocity. */
static void trocar_slide_turn(const trocar_element *e, trocar_element_state *state, const trocar_turn *start,
                              trocar_pair motion, double time)
{
    trocar_turn implicit = trocar_stuck_turn(e, start, motion, time), fitted;
    trocar_pair guess, trial;
    trocar_end end;
//@if lag
    implicit.memory = trocar_rise_after(e, trocar_contact_for(e, start->slip.x), start->rise, time,
                                        trocar_length(start->slip));
//@end
    fitted = trocar_weigh(e, &implicit, &guess);
    if (trocar_newton(e, &fitted, guess, &end)) {
        trocar_end_turn(e, state, &fitted, &end);
        return;
    }
    trial = trocar_turn_elastic(e, &implicit);
    if (!trocar_creeps(e) && trocar_turn_holds(e, trial)) {
        trocar_stick_turn(e, state, &implicit, trial);
        return;
    }
    guess = trocar_turn_guess(e, &implicit, trial, trocar_normal(e, trial));
    if (!trocar_newton(e, &implicit, guess, &end)) {
        end = trocar_search_turn(e, &implicit);
    }
    trocar_end_turn(e, state, &implicit, &end);
}

/* How far beyond the yield set a part of the step without slip leads. */
static double trocar_beyond(const trocar_element *e, const trocar_turn *start, trocar_pair motion, double time)
{
    const trocar_turn turn = trocar_stuck_turn(e, start, motion, time);
    return trocar_utilisation(e, trocar_turn_elastic(e, &turn)) - 1.0;
}

/* Part of the step up to the yield set: a chord and one correction. */
static double trocar_turn_fraction(const trocar_element *e, const trocar_turn *from, trocar_pair motion, double time)
{
    const double end = trocar_beyond(e, from, motion, time), start = trocar_beyond(e, from, motion, 0.0 * time);
    double chord, there;
    if (start >= 0.0) {
        return 0.0;
    }
    chord = -start / (end - start);
    there = trocar_beyond(e, from, motion, chord * time);
    return there > 0.0 ? chord - chord * there / (there - start) : chord + (1.0 - chord) * -there / (end - there);
}

/* Deforms up to the yield point within the step and slides from there. */
static void trocar_yield_turn(const trocar_element *e, trocar_element_state *state, const trocar_turn *start,
                              trocar_pair motion, double time)
{
    const double part = trocar_turn_fraction(e, start, motion, time);
    const trocar_turn reached = trocar_stuck_turn(e, start, motion, part * time);
    const trocar_pair force = trocar_turn_elastic(e, &reached);
    trocar_turn begin = reached;
    begin.z = reached.target;
    trocar_reach(e, start->z.x, start->q, reached.target.x, &begin.q);
//@if arms
    trocar_arm_forces(&reached.arms, reached.target.x - start->z.x, begin.arm_force_n);
//@end
//@if lag
    begin.rise = 1.0;
//@end
    begin.slip.x = begin.slip.t = 0.0;
    begin.onset = trocar_normal(e, force);
//@if stribeck
    if (trocar_falls(e)) {
        /* A law that falls at once is left by a jump of the slip speed. */
        trocar_turn now = trocar_stuck_turn(e, &begin, motion, 0.0);
        const double margin = 1.0 + 1e-5;
        trocar_end end;
        now.z.t *= margin;
        now.target.t *= margin;
        now.q += (margin - 1.0) * force.x;
        if (trocar_newton(e, &now, trocar_turn_guess(e, &now, force, begin.onset), &end)) {
            begin.slip = end.slip;
        }
    }
//@end
    trocar_slide_turn(e, state, &begin, motion, (1.0 - part) * time);
}

/* Whether the slip at the start is not that of the last step: the velocity may have changed. */
static int trocar_starts_anew(const trocar_element *e)
{
//@if damping
    if (!(e->seal_damping[0] == 0.0 && e->seal_damping[1] == 0.0 && e->seal_damping[2] == 0.0)) {
        return 1;
    }
//@end
    return trocar_creeps(e);
}

static void trocar_advance_turning(const trocar_element *e, trocar_element_state *state, trocar_pair motion,
                                   double time)
{
    trocar_turn start;
    start.z.x = state->deflection_m;
    start.z.t = state->around_deflection_m;
    start.q = state->yield_force_n;
    start.slip.x = state->slip_velocity_m_s;
    start.slip.t = state->around_slip_velocity_m_s;
    start.onset.x = start.onset.t = 0.0;
//@if arms
    start.arm_force_n[0] = state->arm_force_n[0];
    start.arm_force_n[1] = state->arm_force_n[1];
//@end
//@if lag
    start.rise = state->rise;
//@end
    if (start.slip.x == 0.0 && start.slip.t == 0.0 && !trocar_creeps(e)) {
        const trocar_turn all = trocar_stuck_turn(e, &start, motion, time);
        const trocar_pair trial = trocar_turn_elastic(e, &all);
        if (trocar_turn_holds(e, trial)) {
            trocar_stick_turn(e, state, &all, trial);
        } else {
            trocar_yield_turn(e, state, &start, motion, time);
        }
        return;
    }
    if (trocar_starts_anew(e)) {
        trocar_turn now = trocar_stuck_turn(e, &start, motion, 0.0);
        trocar_end end;
//@if lag
        now.memory = trocar_rise_at_start(e, start.rise);
//@end
        if (trocar_newton(e, &now, start.slip, &end)) {
            start.slip = end.slip;
        }
    }
    trocar_slide_turn(e, state, &start, motion, time);
}

static void trocar_turn_evenly(const trocar_element *e, trocar_element_state *state, trocar_pair motion, double time,
                               int count)
{
    int part;
    for (part = 0; part < count; ++part) {
//@if dwell
        if (e->dwell_force_n > 0.0) {
            const double each = time / (double)count, age = state->contact_age_s;
            const trocar_pair z = { state->deflection_m, state->around_deflection_m };
            trocar_pair slip = { state->slip_velocity_m_s, state->around_slip_velocity_m_s };
            const trocar_element aged = trocar_aged(e, age, trocar_length(slip), each);
            trocar_advance_turning(&aged, state, motion, each);
            slip.x = motion.x * each - (state->deflection_m - z.x);
            slip.t = motion.t * each - (state->around_deflection_m - z.t);
            state->contact_age_s = trocar_age_after(e, age, trocar_length(slip), each);
            continue;
        }
//@end
        trocar_advance_turning(e, state, motion, time / (double)count);
    }
}

/* In parts as trocar_advance_general. */
static void trocar_turn_element(const trocar_element *e, trocar_element_state *state, trocar_pair motion, double time)
{
    const double travel = fabs(trocar_length(motion)) * time, strides = travel / (0.125 * e->half_width_m);
    trocar_element_state next = *state;
    if (travel <= 0.125 * e->half_width_m) {
        trocar_turn_evenly(e, &next, motion, time, 1);
    } else if (strides <= 32.0) {
        const int below = (int)strides;
        trocar_turn_evenly(e, &next, motion, time, (double)below < strides ? below + 1 : below);
    } else {
        const double first = time * 32.0 / strides;
        trocar_turn_evenly(e, &next, motion, first, 32);
        trocar_turn_evenly(e, &next, motion, time - first, 32);
    }
    if (fabs(next.force_n) <= trocar_greatest && fabs(next.deflection_m) <= trocar_greatest
        && fabs(next.around_deflection_m) <= trocar_greatest) {
        *state = next;
    }
}

